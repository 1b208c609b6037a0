"""Whether a start satisfies the constraints, as far as its mechanism's size lets one ask for it.

The rule, with a share ε, such as the tolerance of a start: a constraint counts as satisfied where
displacing bodies by ε L, or turning them by ε rad, would violate it as much,

    |C_i| ≤ max_j |∂C_i/∂q_j| s_j,  s = ε L of positions, s = ε of angles.

The length L of the mechanism is the largest of the distances between its bodies, the arms by which
joints hold them, and their radius of gyration. So a start that is refused in metres is refused in
micrometres and kilometres, too. Rates count with s times the fastest rate of the start, |v_j| / σ_j
with σ = L or 1 rad, and no less than 1/s. Far from the origin coordinates have fewer digits: s is
no less than some hundred units in the last place.

The size of a violation by which a mechanism has come apart is the largest of these limits for
ε = 1, that is 1 where there are rows of angles, and of the distances of bodies from the origin.

Where no bodies are known, of a `CustomSystem` or a reduced one, units are not known either: C and Ċ
count relative to the largest coordinate and the largest velocity, and these as no less than one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common.partition import detached
from ..linalg import quaternions
from .base import AbstractSystem
from .dynamics import constraint_state
from .structure import Structure

# In units in the last place: what rounding of some terms leaves of a constraint.
_ROUNDING = 100


class Start(NamedTuple):
    """The constraints at a start, and what of them counts as none."""

    violation: Float[Array, " m"]  # C
    rate: Float[Array, " m"]  # Ċ
    allowed: Float[Array, " m"]  # of |C|
    allowed_rate: Float[Array, " m"]  # of |Ċ|
    size: Float[Array, ""]  # of a violation by which the mechanism has come apart

    @classmethod
    def of(
        cls,
        system: AbstractSystem,
        t: Float[Array, ""],
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        share: float,
        share_of_rates: float | None = None,
    ) -> "Start":
        """Return the start at (q, v), by this module's rule; one share for both unless told."""
        state = constraint_state(system, t, q, v)
        q, v = jax.lax.stop_gradient((q, v))
        rates = share if share_of_rates is None else share_of_rates
        if not system.structure.frames or system.m == 0:
            one = jnp.ones(system.m, q.dtype)
            largest, fastest = (jnp.max(jnp.abs(x), initial=1) for x in (q, v))
            allowed = share * largest * one, rates * fastest * one
            return cls(state.violation, state.rate, *allowed, largest)
        (system,) = detached(system)
        # How much a constraint changes where each coordinate changes by what is allowed of it.
        rows = jnp.abs(system.state(t, q, v).jacobian())
        units = _Units.of(system, t, q, rows)
        fastest = jnp.max(units.counts * jnp.abs(v) / units.sizes, initial=1)

        def most(share: float) -> Float[Array, " m"]:
            return jnp.max(rows * units.steps(share, q)[None], axis=1)

        # L does not know how far the ground is that holds a body, which its position tells.
        farthest = jnp.max(jnp.abs(q) * units.positions)
        turned = jnp.max(rows * (units.sizes * units.counts)[None], initial=0)
        size = jnp.maximum(farthest, turned)
        return cls(state.violation, state.rate, most(share), most(rates) * fastest, size)

    @property
    def closed(self) -> Bool[Array, ""]:
        """Whether the constraints hold."""
        return jnp.all(jnp.abs(self.violation) <= self.allowed)

    @property
    def fits(self) -> Bool[Array, ""]:
        """Whether their rates are zero."""
        return jnp.all(jnp.abs(self.rate) <= self.allowed_rate)

    def worst(self) -> int:
        """The constraint that is violated most, for what is allowed."""
        return _worst(self.violation, self.allowed)

    def worst_rate(self) -> int:
        """The constraint whose rate is violated most, for what is allowed."""
        return _worst(self.rate, self.allowed_rate)


def _worst(values: Float[Array, " m"], allowed: Float[Array, " m"]) -> int:
    """The first of those that are largest but for rounding, whatever the machine."""
    # A row of zeros allows nothing and is violated by nothing: 0 / 0 is to be 0.
    share = np.abs(np.asarray(values)) / np.maximum(np.asarray(allowed), 1e-300)
    return int(np.argmax(~(share < (1 - 1e-6) * np.max(share))))


def length_of(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, ""]:
    """The length L of a mechanism of bodies, by the rule of this module [m]."""
    rows = jnp.abs(system.state(t, q, 0 * q).jacobian())
    return _Units.of(system, t, q, rows).length


class _Units(NamedTuple):
    """The unit of each coordinate: L for positions, what a turn by 1 rad changes for others.

    Modes do not count, since each point moves with its frame, too.
    """

    length: Float[Array, ""]
    sizes: Float[Array, " n"]
    counts: np.ndarray
    positions: np.ndarray

    @classmethod
    def of(
        cls,
        system: AbstractSystem,
        t: Float[Array, ""],
        q: Float[Array, " n"],
        rows: Float[Array, "m n"],
    ) -> "_Units":
        structure = system.structure
        positions, turns = _kinds(structure)
        sizes = jnp.ones_like(q)
        if structure.quaternions:
            table = quaternions.columns(structure.quaternions)
            # Turning by 1 rad changes a quaternion by half of its length.
            half = 0.5 * jnp.sqrt(jnp.sum(q[table] ** 2, axis=1, keepdims=True))
            sizes = sizes.at[table].set(jnp.broadcast_to(half, table.shape))
        length = _length(system, t, q, rows * jnp.where(positions, 1, sizes)[None])
        sizes = jnp.where(positions, length, sizes)
        return cls(length, sizes, positions | turns, positions)

    def steps(self, share: float, q: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return s of the rule of this module."""
        rounding = _ROUNDING * jnp.finfo(q.dtype).eps
        farthest = jnp.max(jnp.abs(q) * self.positions)
        least = rounding * jnp.where(self.positions, farthest, jnp.maximum(jnp.abs(q), self.sizes))
        return jnp.maximum(share * self.sizes, least) * self.counts


def _kinds(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Say which coordinates are positions of bodies, and which are turns, counters included."""
    turns = np.zeros(len(structure.coordinates), bool)
    turns[structure.turns] = True
    turns[np.array(structure.counters, int)] = True
    return structure.is_position, turns


def _length(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    rows: Float[Array, "m n"],
) -> Float[Array, ""]:
    """L, from the coordinates and |C_q| by metres and radians [m]."""
    positions, turns = _kinds(system.structure)
    by_turns = jnp.max(jnp.where(turns[None], rows, 0), axis=1)
    by_positions = jnp.max(jnp.where(positions[None], rows, 0), axis=1)
    moved = by_positions > 0
    # Metres of violation per radian: the distance of a joint from the frame of its body.
    arms = jnp.where(moved, by_turns / jnp.where(moved, by_positions, 1), 0)
    return jnp.max(arms, initial=extent_of(system, t, q))


def extent_of(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, ""]:
    """The largest of the distances between bodies and of their radius of gyration [m]."""
    places = q[system.structure.positions]
    apart = jnp.max(jnp.max(places, axis=0) - jnp.min(places, axis=0))
    return jnp.maximum(apart, _gyration(system, t, q))


def _gyration(system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]) -> Array:
    """The radius of gyration of all bodies together, each about its own frame [m]."""
    structure = system.structure
    moving = np.zeros(len(structure.coordinates))
    moving[structure.positions] = 1
    turning = jnp.zeros_like(q)
    if structure.quaternions:
        p = q[structure.turns]
        spun = quaternions.derivative(p, jnp.ones_like(p[:, 1:]))
        turning = turning.at[structure.turns].set(spun)
    else:
        turning = turning.at[structure.turns].set(1)
    both = jnp.stack([jnp.asarray(moving, q.dtype), turning], axis=1)
    # All bodies together are moved by 1 m and turned by 1 rad each, which gives their mean radius
    # of gyration.
    mass, inertia = jnp.sum(both * system.state(t, q, 0 * q).apply_mass(both), axis=0)
    return jnp.sqrt(inertia / mass)
