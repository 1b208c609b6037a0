"""The chapter's reduced model to the letter: a specimen, for comparison only."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis.basis import Basis
from ..common.arrays import Time
from ..integrate.default import start_frequencies
from ..linalg.dense import multiply
from ..linalg.kkt import KKT
from ..reduction.formulation.base import AbstractFormulation, start
from ..system.base import AbstractSystem, AbstractValidity
from ..system.reduced import AbstractReducedSystem, Physical, Reduced, moved_start
from ..system.stabilization import Baumgarte
from ..system.state import AbstractState, Energy, Power
from ..system.structure import Structure
from ..system.validity import TrainingBox


class Projected(AbstractFormulation):
    """z̈ = Φᵀ [M_ext⁻¹ (Q, γ)]₁ with Euclidean-orthonormal Φ (chapter equations 39.6, 39.7).

    For reference only. It projects the *solution* of the full equations instead of the equations:
    the constraint forces do work in the subspace, and energy grows without bound (7e7 times the
    kinetic range in 20 s of a free pendulum, where Galerkin drifts by 2e-10). Nothing is saved
    either: each step solves the full extended system, with all its constraints.

    **Arguments:**

    - `stabilization`: of the full equations; critical damping at their fastest rigid frequency at
      the start unless given.
    """

    name: ClassVar[str] = "projected"
    most_missed: ClassVar[float] = 0.2
    for_reference: ClassVar[bool] = True

    stabilization: Baumgarte | None = None

    def reduce(self, system: AbstractSystem, basis: Basis) -> "ProjectedSystem":
        modes, _ = jnp.linalg.qr(basis.modes)
        q, v, time = start(system, basis)
        stabilization, t = self.stabilization, basis.snapshots.t
        if stabilization is None and system.m:
            # `simulate` chooses the same for the full system over the time of the snapshots.
            rigid = start_frequencies(system, time[None], q, v).rigid
            span = jnp.maximum(t[-1] - t[0], jnp.finfo(t.dtype).tiny)
            stabilization = Baumgarte.critical(jnp.maximum(rigid, 2 * jnp.pi / span))
        box = TrainingBox.of_basis(system, basis, modes, modes.T)
        return ProjectedSystem(
            full=system,
            modes=modes,
            offset=basis.offset,
            stabilization=stabilization,
            q0=multiply(modes.T, q - basis.offset),
            v0=multiply(modes.T, v),
            time=time,
            validity=box,
            structure=Structure.unnamed(basis.rank, 0),
            summary=f"{basis.rank} modes, all {system.m} constraints inside; for reference only",
        )


class ProjectedSystem(AbstractReducedSystem):
    """An ordinary differential equation for z: it knows no constraints of its own."""

    satisfies_dynamics: ClassVar[bool] = False

    full: AbstractSystem
    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    stabilization: Baumgarte | None
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    time: Float[Array, ""]
    validity: AbstractValidity | None
    structure: Structure = eqx.field(static=True)
    summary: str = eqx.field(static=True)

    def with_full(self, full: AbstractSystem) -> "ProjectedSystem":
        rom = dataclasses.replace(self, full=full)
        z, w = moved_start(self, rom)
        return dataclasses.replace(rom, q0=z, v0=w)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        del t
        return self.offset + multiply(self.modes, q), multiply(self.modes, v)

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        """The nearest ones in the Euclidean norm."""
        return multiply(self.modes.T, q - self.offset), multiply(self.modes.T, v)

    def mass(self, q: Float[Array, " r"]) -> Float[Array, "r r"]:
        return jnp.eye(self.n, dtype=q.dtype)

    def force(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Float[Array, " r"]:
        """The chapter's z̈."""
        a, _ = self.full.acceleration(t, *self.reconstruct(t, q, v), self.stabilization)
        return multiply(self.modes.T, a)

    def constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " 0"]:
        return jnp.zeros(0, q.dtype)

    def state(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> "ProjectedState":
        return ProjectedState(self, t, q, v)


@dataclasses.dataclass(frozen=True)
class ProjectedState(AbstractState):
    """z̈ = Q with a unit mass matrix."""

    system: ProjectedSystem
    t: Time
    z: Float[Array, " r"]
    w: Float[Array, " r"]

    @property
    def q(self) -> Float[Array, " n"]:  # type: ignore[override]
        return self.system.offset + multiply(self.system.modes, self.z)

    @property
    def v(self) -> Float[Array, " n"]:  # type: ignore[override]
        return multiply(self.system.modes, self.w)

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        return x

    def jacobian(self) -> Float[Array, "0 r"]:
        return jnp.zeros((0, self.system.n), self.z.dtype)

    def force(self) -> Float[Array, " r"]:
        return self.system.force(self.t, self.z, self.w)

    def kkt(self) -> KKT:
        return KKT.dense(self.jacobian(), jnp.ones(self.system.n, self.z.dtype))

    def energy(self) -> Energy:
        return self._full.energy().by_coordinates(self.system.modes)

    def power(self) -> Power | None:
        return self._full.power()

    @property
    def _full(self) -> AbstractState:
        return self.system.full.state(self.t, self.q, self.v)

    def physical_acceleration(self, a: Float[Array, " r"]) -> Float[Array, " n"]:
        return multiply(self.system.modes, a)
