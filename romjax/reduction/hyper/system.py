"""The hyper-reduced system: a few weighted bodies stand for all."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.locate import assembled
from ...assembly.part import part
from ...common.arrays import Time
from ...linalg.dense import multiply
from ...linalg.kkt import KKT
from ...system.base import AbstractSystem, AbstractValidity
from ...system.reduced import AbstractReducedSystem, Physical, Reduced, check_alike, moved_start
from ...system.state import AbstractState, Energy, Power
from ...system.structure import Structure
from ..lift.base import Motion
from ..lift.closed_form import ClosedFormLift
from ..system import ReducedState
from .kinematics import Rotations, SampledKinematics, sample_kinematics
from .loads import LinearLoads


class Sample(eqx.Module):
    """The sampled bodies and effects of a hyper-reduced model, whatever the system's numbers.

    - `bodies`: rows of each group of bodies, with the `weights` of their Lagrangians.
    - `linear`, `others`: groups of effects, by whether they are linear in z.
    - `columns`: of the bodies' coordinates in q; `turned`: pairs x, y of these that are not affine.
    """

    bodies: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    weights: tuple[Float[Array, " count"], ...]
    linear: tuple[int, ...] = eqx.field(static=True)
    others: tuple[int, ...] = eqx.field(static=True)
    columns: tuple[int, ...] = eqx.field(static=True)
    turned: tuple[tuple[int, int], ...] = eqx.field(static=True)
    rotations: Rotations


class HyperReducedSystem(AbstractReducedSystem):
    """The Lagrangian L(z, w) = Σ ξ_b L_b(q_b(z), G_b w) of sampled bodies b, with all loads.

    A step costs nothing of the number of bodies; outputs are lifted to all of them. The weights ξ
    are not negative, so the mass matrix is symmetric and positive definite, and energy is conserved
    as in the model that is not sampled. Made by `reduce`.

    - `full`: the system that was reduced. `lift`: of all coordinates. `sample`: which bodies.
    - `bodies`, `kinematics`, `loads`: the sampled ones, how they move, and the linear effects.
    - `q0`, `v0` (r,): the start, at `time` [s].
    - `validity`: what it was made of. `structure`, `summary`: what it is, by names and in words.
    """

    full: AssembledSystem
    lift: ClosedFormLift
    sample: Sample
    bodies: AssembledSystem
    kinematics: SampledKinematics
    loads: LinearLoads | None
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    time: Float[Array, ""]
    validity: AbstractValidity | None
    structure: Structure = eqx.field(static=True)
    summary: str = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        full: AssembledSystem,
        lift: ClosedFormLift,
        sample: Sample,
        start: tuple[Reduced, Reduced, Float[Array, ""]],
        validity: AbstractValidity | None,
        structure: Structure,
        summary: str,
    ) -> "HyperReducedSystem":
        """Make the system with the reduced `start` z, w, t.

        `full`, `lift`, `sample`, `validity`, `structure` and `summary` are fields.
        """
        bodies = part(full, sample.bodies, sample.weights, sample.others)
        how = sample_kinematics(full, lift, sample.rotations, sample.columns, sample.turned)
        loads = LinearLoads.of(full, lift, sample.linear)
        return cls(full, lift, sample, bodies, how, loads, *start, validity, structure, summary)

    def mass(self, q: Reduced) -> Float[Array, "r r"]:
        return self.state(self.time, q, jnp.zeros_like(q)).inner.mass()

    def constraint(self, t: Time, q: Reduced) -> Float[Array, " m"]:
        del t
        return jnp.zeros(0, q.dtype)

    def state(self, t: Time, q: Reduced, v: Reduced) -> "HyperReducedState":
        motion = self.kinematics.motion(q, v)
        bodies = self.bodies.state(t, motion.q, motion.v)
        inner = ReducedState(motion.q, motion.v, motion, bodies, None)
        return HyperReducedState(self, t, q, v, inner)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        position = lambda z: self.lift.position(self.full, t, z)  # noqa: E731
        both: tuple[Physical, Physical] = jax.jvp(position, (q,), (v,))
        return both

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        return self.lift.restrict(self.full, q, v)

    def with_full(self, full: AbstractSystem) -> "HyperReducedSystem":
        check_alike(self.full, full)
        full = assembled("with_full", full)
        known, lift = (self.validity, self.structure, self.summary), self.lift.with_full(full)
        rom = self.of(full, lift, self.sample, (self.q0, self.v0, self.time), *known)
        z, w = moved_start(self, rom)
        return dataclasses.replace(rom, q0=z, v0=w)


@dataclasses.dataclass(frozen=True)
class HyperReducedState(AbstractState):
    """A state of the sampled bodies, seen as one of the full system."""

    system: HyperReducedSystem
    t: Time
    z: Reduced
    w: Reduced
    inner: ReducedState  # of the sampled bodies

    @functools.cached_property
    def _motion(self) -> Motion:
        """Return the motion of all bodies; only accelerations of outputs need it."""
        return self.system.lift.motion(self.system.full, self.t, self.z, self.w)

    @functools.cached_property
    def _physical(self) -> tuple[Physical, Physical]:
        return self.system.reconstruct(self.t, self.z, self.w)

    @property
    def q(self) -> Physical:  # type: ignore[override]
        return self._physical[0]

    @property
    def v(self) -> Physical:  # type: ignore[override]
        return self._physical[1]

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        return self.inner.apply_mass(x)

    def jacobian(self) -> Float[Array, "m r"]:
        return jnp.zeros((0, self.z.size), self.z.dtype)

    def force(self) -> Reduced:
        force, loads = self.inner.force(), self.system.loads
        return force if loads is None else force + loads.at(self.z, self.w)

    def energy(self) -> Energy:
        energy, loads = self.inner.energy(), self.system.loads
        if loads is None:
            return energy
        # The slope of the potential is minus the force at rest.
        slope = energy.slope - loads.at(self.z, jnp.zeros_like(self.w))
        potential = energy.potential + loads.stored(self.z)
        return energy._replace(potential=potential, slope=slope)

    def power(self) -> Power | None:
        powers = [self.inner.power()]
        if self.system.loads is not None:
            powers.append(self.system.loads.power(self.w))
        given = [power for power in powers if power is not None]
        return Power(*(sum(x) for x in zip(*given, strict=True))) if given else None

    def kkt(self) -> KKT:
        return KKT.dense(self.jacobian(), self.inner.mass())

    def physical_acceleration(self, a: Reduced) -> Physical:
        pushed: Array = multiply(self._motion.tangent, a)
        return pushed if self._motion.bias is None else pushed + self._motion.bias
