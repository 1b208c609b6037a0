"""The reduced system: a lift, and the constraints that are kept."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis.turns import Turns, by_turn
from ..common.arrays import Time
from ..compiling.program import program_once
from ..linalg.dense import multiply
from ..linalg.kkt import KKT
from ..scene.coordinate import Coordinate
from ..system.base import AbstractSystem, AbstractValidity
from ..system.reduced import AbstractReducedSystem, check_alike, moved_start, started
from ..system.state import AbstractState, Energy, Power
from ..system.structure import Structure
from .lift.atlas import AtlasLift
from .lift.base import AbstractLift, Motion, Physical, Reduced


class ReducedSystem(AbstractReducedSystem):
    """GᵀMG z̈ + (UᵀC_q G)ᵀ λ = Gᵀ(Q − M β), UᵀC(t, L(t, z)) = 0, on q = L(t, z), q̈ = G z̈ + β.

    d'Alembert's principle: virtual displacements are δq = G δz, so the virtual work of the full
    equations vanishes on the lift, and the energy balance survives. Of the constraints, the
    combinations U are kept that the lift can violate. Made by `reduce`.

    - `full`: the system that was reduced. `lift`: L. `combinations` U (M, m): None keeps none.
    - `q0`, `v0` (r,): the start. `time` [s]: at which `mass` is, where constraints depend on time.
    - `turns`: the scale of its quaternions in space, None in the plane.
    - `validity`: what it was made of. `structure`, `summary`: what it is, by names and in words.
    """

    full: AbstractSystem
    lift: AbstractLift
    combinations: Float[Array, "M m"] | None
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    time: Float[Array, ""]
    turns: Turns | None
    validity: AbstractValidity | None
    structure: Structure = eqx.field(static=True)
    summary: str = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        full: AbstractSystem,
        lift: AbstractLift,
        start: tuple[Physical, Physical, Float[Array, ""]],
        combinations: Float[Array, "M m"] | None = None,
        validity: AbstractValidity | None = None,
        summary: str = "",
        turns: Turns | None = None,
    ) -> "ReducedSystem":
        """Make the system with the `start` nearest to physical (q, v, t).

        The fields are as `ReducedSystem` has.
        """
        q, v, time = start
        z, w = _restrict(lift, full, turns, q, v)
        m = 0 if combinations is None else combinations.shape[1]
        structure = Structure(
            tuple(Coordinate("", f"z{i + 1}") for i in range(z.size)),
            tuple(f"kept combination {i + 1} of the constraints" for i in range(m)),
            rigid=(True,) * z.size,
            flexible=True,
            loops=m > 0 and full.structure.loops,
            contacts=full.structure.contacts,
        )
        held, known = combinations if m else None, (turns, validity, structure, summary)
        return started(cls(full, lift, held, z, w, time, *known), z, w, time)

    def mass(self, q: Reduced) -> Float[Array, "r r"]:
        return self.state(self.time, q, jnp.zeros_like(q)).mass()

    def constraint(self, t: Time, q: Reduced) -> Float[Array, " m"]:
        if self.combinations is None:
            return jnp.zeros(0, q.dtype)
        position = self.lift.position(self.full, t, q)
        return multiply(self.combinations.T, self.full.constraint(t, position))

    def state(self, t: Time, q: Reduced, v: Reduced) -> "ReducedState":
        motion = self.lift.motion(self.full, t, q, v)
        inner = self.full.state(t, motion.q, motion.v)
        return ReducedState(motion.q, motion.v, motion, inner, self.combinations)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        motion = self.lift.motion(self.full, t, q, v)
        return motion.q, motion.v

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        z, w = _restrict(self.lift, self.full, self.turns, q, v)
        return z, w

    def in_chart_of(self, q: Physical) -> "ReducedSystem":
        if not isinstance(self.lift, AtlasLift):
            return self
        q = q if self.turns is None else by_turn(self.turns, q)
        lift = eqx.tree_at(lambda atlas: atlas.current, self.lift, self.lift.number(q))
        return dataclasses.replace(self, lift=lift)

    def with_full(self, full: AbstractSystem) -> "ReducedSystem":
        check_alike(self.full, full)
        rom = dataclasses.replace(self, full=full, lift=self.lift.with_full(full))
        if not has_charts(self):
            return started(rom, *moved_start(self, rom), self.time)
        # No other chart has the same coordinates.
        q, v = self.reconstruct(self.time, self.q0, self.v0)
        return rom.starting_at(q + (full.q0 - self.full.q0), v + (full.v0 - self.full.v0))


def has_charts(system: AbstractSystem) -> bool:
    """Whether the coordinates of a system refer to one of several charts."""
    return isinstance(system, ReducedSystem) and isinstance(system.lift, AtlasLift)


@program_once
def _restrict(
    lift: AbstractLift, full: AbstractSystem, turns: Turns | None, q: Physical, v: Physical
) -> tuple[Reduced, Reduced]:
    return lift.restrict(full, *((q, v) if turns is None else turns(q, v)))


@dataclasses.dataclass(frozen=True)
class ReducedState(AbstractState):
    """A reduced system at one state: the full system's state there, seen through the lift."""

    q: Physical
    v: Physical
    motion: Motion
    inner: AbstractState  # of the full system
    combinations: Float[Array, "M m"] | None

    @functools.cached_property
    def _pushed(self) -> Float[Array, "n columns"]:
        """M G, and M β as one more column where there is a bias."""
        _, _, tangent, bias = self.motion
        columns = tangent if bias is None else jnp.concatenate([tangent, bias[:, None]], axis=1)
        return self.inner.apply_mass(columns)

    def mass(self) -> Float[Array, "r r"]:
        """GᵀMG."""
        tangent = self.motion.tangent
        return multiply(tangent.T, self._pushed[:, : tangent.shape[1]])

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        tangent = self.motion.tangent
        return multiply(tangent.T, self.inner.apply_mass(multiply(tangent, x)))

    def jacobian(self) -> Float[Array, "m r"]:
        tangent = self.motion.tangent
        if self.combinations is None:
            return jnp.zeros((0, tangent.shape[1]), tangent.dtype)
        return multiply(multiply(self.combinations.T, self.inner.jacobian()), tangent)

    def force(self) -> Reduced:
        force = self.inner.force()
        if self.motion.bias is not None:
            force -= self._pushed[:, -1]
        return multiply(self.motion.tangent.T, force)

    def energy(self) -> Energy:
        return self.inner.energy().by_coordinates(self.motion.tangent)

    def power(self) -> Power | None:
        return self.inner.power()

    def residual(self, a: Reduced) -> Reduced:
        pushed = self.inner.apply_mass(self.physical_acceleration(a))
        return multiply(self.motion.tangent.T, pushed - self.inner.force())

    def kkt(self) -> KKT:
        return KKT.dense(self.jacobian(), self.mass())

    def physical_acceleration(self, a: Reduced) -> Physical:
        _, _, tangent, bias = self.motion
        pushed = multiply(tangent, a)
        return pushed if bias is None else pushed + bias
