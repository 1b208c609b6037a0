"""Minimal coordinates from which the others follow in closed form."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...linalg.branches import AbstractInverse, inverted
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ..charts.chart import Chart
from .base import AbstractLift, Motion, Physical, Reduced, differentiate


class ClosedFormLift(AbstractLift):
    """q − q̄ = (Φ z, d(t, z)) in the order of the coordinates, for constraints affine in d.

    Where ∂C/∂d is constant, as it is for the positions of the bodies of an open chain, one step of
    Newton's method is exact from any d₀: d = d₀ − (∂C/∂d)⁻¹ C(t, Φ z, d₀).
    """

    offset: Float[Array, " n"]  # q̄
    inner: Float[Array, "d r"]  # Φ, a basis of the independent coordinates s
    dual: Float[Array, "r n"]  # z of a displacement
    guess: Float[Array, " m"]  # d₀
    inverse: AbstractInverse  # (∂C/∂d)⁻¹
    time: Float[Array, ""]  # at which it was evaluated
    chart: Chart

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        d = self.guess - self.inverse.apply(self._violation(full, t, z))
        return self.offset + self.chart.ordered(multiply(self.inner, z), d)

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        # Only the rows of d in the tangent need a derivative.
        slopes = jax.jacfwd(lambda z: self._violation(full, t, z))(z)
        tangent = self.chart.ordered(self.inner, -self.inverse.apply(slopes))
        return differentiate(lambda t, z: self.position(full, t, z), t, z, w, tangent)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        del full
        return multiply(self.dual, q - self.offset), multiply(self.dual, v)

    def with_full(self, full: AbstractSystem) -> "ClosedFormLift":
        guess, matrix = self.chart.held_by(full, self.time, self.offset, self.guess)
        return dataclasses.replace(self, guess=guess, inverse=inverted(matrix, self.chart.forest))

    def _violation(self, full: AbstractSystem, t: Time, z: Reduced) -> Float[Array, " m"]:
        """The constraints where d is that of the guess."""
        if not self.chart.rows:
            return jnp.zeros(0, z.dtype)
        q = self.offset + self.chart.ordered(multiply(self.inner, z), self.guess)
        return self.chart.constraint(full, t, q)
