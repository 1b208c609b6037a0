"""The chapter's reduced model to the letter, for reference only."""

import equinox as eqx
from jaxtyping import Array, Float

from ...scene.fields import Time
from ..base import AbstractSystem, Linearization
from ..stabilization import Baumgarte
from .base import AbstractReducedSystem


class ProjectedSystem(AbstractReducedSystem):
    """z̈ = Φᵀ [M_ext⁻¹ (Q, γ)]₁ with Euclidean-orthonormal Φ (chapter equations 39.6, 39.7).

    For reference only. It projects the *solution* of the full equations instead of the equations:
    the constraint forces do work in the subspace, and energy grows without bound (7e7 times the
    kinetic range in 20 s of a free pendulum, where Galerkin drifts by 2e-10). Nothing is saved
    either: each step solves the full extended system, with all its constraints.
    """

    full: AbstractSystem
    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    reason: str = eqx.field(static=True)

    @property
    def m(self) -> int:
        return self.full.m

    def constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " m"]:
        return self.full.constraint(t, self.lift(q))

    def constraint_label(self, row: int) -> str:
        return self.full.constraint_label(row)

    def acceleration(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> tuple[Float[Array, " r"], Float[Array, " m"]]:
        """The chapter's z̈, and the multipliers of the full system."""
        a, multipliers = self.full.acceleration(t, *self.physical(q, v), stabilization)
        return self.modes.T @ a, multipliers

    def linearize(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> Linearization:
        full = self.full.linearize(t, *self.physical(q, v), stabilization)
        down, up = self.modes.T, self.modes
        return Linearization(
            down @ full.acceleration,
            down @ full.by_position @ up,
            down @ full.by_velocity @ up,
            down @ full.by_time,
        )
