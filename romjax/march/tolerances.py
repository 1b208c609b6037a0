"""How large errors may be in a motion, of whatever size it is."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common.arrays import Numbers

# Rounding errors of positions in a step, in units in the last place of the farthest position, and
# at least of these [m, and rad or 1]: forces depend on numbers of this size even where it is zero.
_ROUNDING, _NEAREST = 20, (1e-3, 1.0)


class Reach(NamedTuple):
    """The reach of a motion so far: for each coordinate, the largest among those of its kind.

    There are two kinds, positions of bodies [m] and all others: angles, amplitudes, and the
    coordinates of systems of which no bodies are known.

    - `origin`: from where distances count, the first positions in the chart of the state.
    - `sizes`: of three rows, the `distance` from there, the `speed`, and the `farthest` position
      itself, of which rounding is a share, at least `_NEAREST`.

    As one array, since each operation on three would be three more in every program.
    """

    origin: Float[Array, " n"]
    sizes: Float[Array, "3 n"]

    @property
    def distance(self) -> Float[Array, " n"]:
        return self.sizes[0]

    @property
    def speed(self) -> Float[Array, " n"]:
        return self.sizes[1]

    @property
    def farthest(self) -> Float[Array, " n"]:
        return self.sizes[2]


class Extent(NamedTuple):
    """The largest of each coordinate in a run: the `farthest` from zero, the `distance` from the
    start, and the `speed`.
    """

    farthest: Float[Numbers, " n"]
    distance: Float[Numbers, " n"]
    speed: Float[Numbers, " n"]

    @classmethod
    def of(
        cls, q: Float[Array | np.ndarray, "k n"], v: Float[Array | np.ndarray, "k n"]
    ) -> "Extent":
        """Return the extent of states of a run; by NumPy where these are its arrays."""
        if isinstance(q, np.ndarray):
            return cls(*(np.max(np.abs(x), axis=0) for x in (q, q - q[:1], v)))
        q, v = jax.lax.stop_gradient((q, v))
        sizes = tuple(jnp.abs(x) for x in (q, q - q[:1], v))

        def larger(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
            return tuple(map(jnp.maximum, a, b))

        # In one pass, which takes XLA less time than three; no loop, whose rows would be steps one
        # after the other on a GPU.
        return cls(*jax.lax.reduce(sizes, (np.zeros((), q.dtype),) * 3, larger, (0,)))


class Tolerances(eqx.Module):
    """The errors that the steps of a run may have.

    Given tolerances are atol + rtol |q| in positions, and atol + rtol |v| in velocities.

    Others `follow` the motion, so that one of a micrometre is as accurate as one of a metre, and as
    it is at any distance from the origin. They are rtol max(min(D, 1), |q − q(0)|) + R in
    positions, and rtol max(min(S, 1), |v|) + R / h in velocities, with the largest distance D and
    the largest speed S so far among the positions of bodies [m, m/s], or among all other
    coordinates. R is what rounding leaves of positions, and R / h has as much of an effect in a
    step h. A state of an effect is of a kind by itself, whatever its size. Coordinates with other
    units than those of their kind have `shares` of min(D, 1) and min(S, 1), as amplitudes have.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    follow: Bool[Array, ""]
    positions: tuple[bool, ...] = eqx.field(static=True)  # whether coordinates are those of bodies
    # Whether their rates are states of effects; empty where none are.
    states: tuple[bool, ...] = eqx.field(static=True, default=())
    shares: Float[Array, " n"] | None = None

    @classmethod
    def of(
        cls,
        positions: Bool[np.ndarray, " n"],
        rtol: Any,
        atol: Any,
        follow: Any,
        states: Bool[np.ndarray, " n"] | None = None,
        shares: Float[Array, " n"] | None = None,
    ) -> "Tolerances":
        numbers = jnp.asarray(rtol), jnp.asarray(atol), jnp.asarray(follow)
        kinds = () if states is None or not states.any() else tuple(states.tolist())
        return cls(*numbers, tuple(positions.tolist()), kinds, shares)

    def start(self, y: Any) -> Reach:
        """Return the reach of the motion before the first step."""
        q = jax.lax.stop_gradient(y[0])
        nearest = np.where(self.positions, *_NEAREST)
        sizes = jnp.asarray(np.stack([0 * nearest, 0 * nearest, nearest]), q.dtype)
        return self.extended(Reach(q, sizes), y)

    def extended(self, reach: Reach, y: Any) -> Reach:
        """Return the reach with a state in the same chart added."""
        q, v, *_ = (jax.lax.stop_gradient(x) for x in y)
        sizes = self._largest(jnp.abs(jnp.stack([q - reach.origin, v, q])))
        return Reach(reach.origin, jnp.maximum(reach.sizes, sizes))

    def after(self, reach: Reach, y0: Any, y1: Any) -> Reach:
        """Return the reach after a step from `y0` to `y1`, which may be in another chart."""
        longer = self.extended(reach, in_one_chart(y0, y1))
        return longer._replace(origin=next_origin(longer, y0, y1))

    def errors(
        self,
        reach: Reach,
        q: Float[Array, "k n"],
        v: Float[Array, "k n"],
        h: Float[Array, ""],
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Return the allowed errors of positions and velocities, the largest for any of k states.

        They are those of steps of the length h that end or begin there.
        """
        q, v = jax.lax.stop_gradient((q, v))
        moved = jnp.max(jnp.abs(jnp.stack([q - reach.origin[None], v])), axis=1)
        largest = jnp.max(jnp.abs(jnp.stack([q, v])), axis=1)
        by_q, by_v = self._errors(reach, moved, largest, h)
        return by_q, by_v

    def errors_in_run(
        self, reach: Reach, extent: Extent, h: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Return the same of all states of a run, whose first one is the origin."""
        moved = jnp.stack([extent.distance, extent.speed])
        by_q, by_v = self._errors(reach, moved, jnp.stack([extent.farthest, extent.speed]), h)
        return by_q, by_v

    def _errors(
        self, reach: Reach, moved: Float[Array, "2 n"], largest: Float[Array, "2 n"], h: Array
    ) -> Float[Array, "2 n"]:
        noise = self.rounding(reach)
        # States of effects have units of their own, of which 1 says nothing.
        most = jnp.asarray(np.where([self.states], np.inf, 1), moved.dtype) if self.states else 1
        sizes = jnp.minimum(reach.sizes[:2], most)
        sizes = sizes if self.shares is None else sizes * self.shares[None]
        followed = self.rtol * jnp.maximum(sizes, moved)
        # In a step h an error R / h of velocities moves positions by R.
        followed += jnp.stack([noise, noise / h])
        errors: Array = jnp.where(self.follow, followed, self.atol + self.rtol * largest)
        return errors

    def rounding(self, reach: Reach) -> Float[Array, " n"]:
        """Return the rounding errors of positions in a step."""
        return _ROUNDING * jnp.finfo(reach.sizes.dtype).eps * reach.farthest

    def reached(self, q0: Float[Array, " n"], extent: Extent) -> Reach:
        """Return the reach of a run that starts at q0 and has an extent."""
        start = self.start((q0, jnp.zeros_like(q0)))
        sizes = self._largest(jnp.stack([extent.distance, extent.speed, extent.farthest]))
        return Reach(start.origin, jnp.maximum(start.sizes, sizes))

    def _largest(self, sizes: Float[Array, "rows n"]) -> Float[Array, "rows _"]:
        """The largest of each row among the coordinates of each kind; of states each by itself."""
        if self.states:
            own = np.array([self.states])
            others = Tolerances.of(np.array(self.positions), self.rtol, self.atol, self.follow)
            return jnp.where(own, sizes, others._largest(jnp.where(own, 0, sizes)))
        which = np.array(self.positions, bool)
        if not len(which):
            return sizes
        if which.all() or not which.any():
            return jnp.max(sizes, axis=1, keepdims=True)
        # Products with masks instead of choices, which are several operations each.
        kinds = (each[None].astype(sizes.dtype) for each in (which, ~which))
        one, other = (kind * jnp.max(kind * sizes, axis=1, keepdims=True) for kind in kinds)
        largest: Array = one + other
        return largest


def in_one_chart(y0: Any, y1: Any) -> Any:
    """The end of a step, or its start again where another chart begins, whose coordinates do not
    compare with those before.
    """
    if len(y0) < 3:
        return y1
    return jax.tree.map(lambda a, b: jnp.where(y0[2] != y1[2], a, b), y0, y1)


def next_origin(reach: Reach, y0: Any, y1: Any) -> Float[Array, " n"]:
    """Return the origin of distances after a step, which is its end where another chart begins."""
    return reach.origin if len(y0) < 3 else jnp.where(y0[2] != y1[2], y1[0], reach.origin)
