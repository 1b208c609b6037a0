"""How large errors may be in a motion, of whatever size it is."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# What rounding leaves of positions in a step, in units in the last place of the farthest, or of
# these [m, and rad or 1]: zero is as far from the numbers that forces depend on.
_ROUNDING, _NEAREST = 20, (1e-3, 1.0)


class Reach(NamedTuple):
    """How far a motion has got. Pairs are of the positions of bodies [m], and of all other
    coordinates: angles, amplitudes, and those of systems of which no bodies are known.

    - `origin`: from where distances count, the first positions in the chart of the state.
    - `distance`: the largest of them. `speed`: the largest rate.
    - `farthest`: the largest position itself, of which rounding is a share; at least `_NEAREST`.
    """

    origin: Float[Array, " n"]
    distance: Float[Array, "2"]
    speed: Float[Array, "2"]
    farthest: Float[Array, "2"]


class Tolerances(eqx.Module):
    """The errors that the steps of a run may have.

    Given tolerances are atol + rtol |q| in positions, and atol + rtol |v| in velocities.

    Others `follow` the motion, so that one of a micrometre is as accurate as one of a metre, and as
    it is at any distance from the origin. They are rtol max(min(D, 1), |q − q(0)|) + R in
    positions, and rtol max(min(S, 1), |v|) + R / h in velocities, with the largest distance D and
    the largest speed S so far among the positions of bodies [m, m/s], or among all other
    coordinates. R is what rounding leaves of positions, and R / h has as much of an effect in a
    step h.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    follow: Bool[Array, ""]
    positions: tuple[bool, ...] = eqx.field(static=True)  # whether coordinates are those of bodies

    @classmethod
    def of(
        cls, positions: Bool[np.ndarray, " n"], rtol: Any, atol: Any, follow: Any
    ) -> "Tolerances":
        numbers = jnp.asarray(rtol), jnp.asarray(atol), jnp.asarray(follow)
        return cls(*numbers, tuple(positions.tolist()))

    def start(self, y: Any) -> Reach:
        """Before the first step."""
        q, zero = jax.lax.stop_gradient(y[0]), jnp.zeros(2, y[0].dtype)
        return self.extended(Reach(q, zero, zero, jnp.asarray(_NEAREST, q.dtype)), y)

    def extended(self, reach: Reach, y: Any) -> Reach:
        """With a state in the same chart."""
        q, v, *_ = (jax.lax.stop_gradient(x) for x in y)
        return Reach(
            reach.origin,
            jnp.maximum(reach.distance, self._largest(q - reach.origin)),
            jnp.maximum(reach.speed, self._largest(v)),
            jnp.maximum(reach.farthest, self._largest(q)),
        )

    def after(self, reach: Reach, y0: Any, y1: Any) -> Reach:
        """After a step from the state `y0` to `y1`, which may be in another chart."""
        changes = _changes_chart(y0, y1)
        longer = self.extended(reach, in_one_chart(y0, y1))
        return longer._replace(origin=jnp.where(changes, y1[0], longer.origin))

    def errors(
        self, reach: Reach, y: Any, h: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """In positions and velocities, of a step h to or from the state `y`."""
        q, v, *_ = (jax.lax.stop_gradient(x) for x in y)
        far, fast = (self.each(jnp.minimum(x, 1)) for x in (reach.distance, reach.speed))
        noise = self.rounding(reach)
        by_q = self.rtol * jnp.maximum(far, jnp.abs(q - reach.origin)) + noise
        by_v = self.rtol * jnp.maximum(fast, jnp.abs(v)) + noise / h
        return (
            jnp.where(self.follow, by_q, self.atol + self.rtol * jnp.abs(q)),
            jnp.where(self.follow, by_v, self.atol + self.rtol * jnp.abs(v)),
        )

    def rounding(self, reach: Reach) -> Float[Array, " n"]:
        """What it leaves of positions in a step."""
        return self.each(_ROUNDING * jnp.finfo(reach.farthest.dtype).eps * reach.farthest)

    def reached(self, q: Float[Array, "k n"], v: Float[Array, "k n"]) -> Reach:
        """How far the motion has got in all states of a run."""
        each = jax.vmap(self.extended, in_axes=(None, 0))(self.start((q[0], v[0])), (q, v))
        reach: Reach = jax.tree.map(lambda x: jnp.max(x, axis=0), each)
        return reach

    def largest(
        self, q: Float[Array, "k n"], v: Float[Array, "k n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The largest errors in any of the states of a run, but for rounding in velocities."""
        reach = self.reached(q, v)
        errors = jax.vmap(lambda *y: self.errors(reach, y, jnp.asarray(jnp.inf)))(q, v)
        by_q, by_v = (jnp.max(rows, axis=0) for rows in errors)
        return by_q, by_v

    def _largest(self, x: Float[Array, " n"]) -> Float[Array, "2"]:
        """Of a pair."""
        sizes, which = jnp.abs(x), np.array(self.positions, bool)
        both = (jnp.max(sizes, where=own, initial=0.0) for own in (which, ~which))
        return jnp.stack(list(both))

    def each(self, pair: Float[Array, "2"]) -> Float[Array, " n"]:
        """What of a pair is for each coordinate."""
        own: Array = jnp.where(np.array(self.positions, bool), pair[0], pair[1])
        return own


def in_one_chart(y0: Any, y1: Any) -> Any:
    """The end of a step, or its start again where another chart begins, whose coordinates do not
    compare with those before.
    """
    changes = _changes_chart(y0, y1)
    return jax.tree.map(lambda a, b: jnp.where(changes, a, b), y0, y1)


def _changes_chart(y0: Any, y1: Any) -> Bool[Array, ""]:
    changes: Array = y0[2] != y1[2] if len(y0) == 3 else jnp.zeros((), bool)
    return changes
