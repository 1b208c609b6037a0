"""The chapter's reduced model to the letter, for reference only."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg.dense import multiply
from ..reduction.base import AbstractSubspaceSystem
from ..reduction.validity import Training
from ..system.base import AbstractSystem, Linearization
from ..system.stabilization import Baumgarte


class ProjectedSystem(AbstractSubspaceSystem):
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
    training: Training | None
    reason: str = eqx.field(static=True)

    holds: ClassVar[bool] = False  # its motion is that of a subspace that knows no constraints

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
        a, multipliers = self.full.acceleration(t, *self.physical(t, q, v), stabilization)
        return self.modes.T @ a, multipliers

    def linearize(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> Linearization:
        full = self.full.linearize(t, *self.physical(t, q, v), stabilization)
        down, up = self.modes.T, self.modes
        return Linearization(
            down @ full.acceleration,
            down @ full.by_position @ up,
            down @ full.by_velocity @ up,
            down @ full.by_time,
        )

    def lost_energy(
        self, ts: Float[Array, " k"], q: Float[Array, "k r"], v: Float[Array, "k r"]
    ) -> Float[Array, ""]:
        """The work of the constraint forces that the projection leaves, by the trapezoidal rule."""

        def power(t, q, v):  # type: ignore[no-untyped-def]
            place, speed = self.physical(t, q, v)
            a, _ = self.acceleration(t, q, v)
            pushed = self.full.momentum(place, multiply(self.modes, a))
            lost = speed @ (pushed - self.full.force(t, place, speed))
            return lost, 0.5 * speed @ self.full.momentum(place, speed)

        lost, kinetic = jax.vmap(power)(ts, q, v)
        work = jnp.concatenate(
            [jnp.zeros(1), jnp.cumsum(jnp.diff(ts) * (lost[1:] + lost[:-1]) / 2)]
        )
        extent = jnp.max(kinetic) - jnp.min(kinetic)
        return jnp.max(jnp.abs(work)) / jnp.where(extent > 0, extent, 1)
