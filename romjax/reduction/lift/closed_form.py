"""Minimal coordinates from which the others follow in closed form."""

from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...arrays import Time
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ..charts import Chart
from .base import AbstractLift, Motion


class ClosedFormLift(AbstractLift):
    """q − q̄ = (Φ z, d(t, z)) in the order of the coordinates, for constraints affine in d.

    Where ∂C/∂d is constant, as it is for the positions of the bodies of an open chain, one step of
    Newton's method is exact from any d₀: d = d₀ − (∂C/∂d)⁻¹ C(t, Φ z, d₀).
    """

    offset: Float[Array, " n"]  # q̄
    inner: Float[Array, "d r"]  # Φ, a basis of the independent coordinates s
    dual: Float[Array, "r n"]  # z of a displacement
    guess: Float[Array, " m"]  # d₀
    inverse: Float[Array, "m m"]  # (∂C/∂d)⁻¹
    time: Float[Array, ""]  # at which it was evaluated
    chart: Chart

    def position(self, full: AbstractSystem, t: Time, z: Float[Array, " r"]) -> Float[Array, " n"]:
        d = self.guess - multiply(self.inverse, self._violation(full, t, z))
        return self.offset + self.chart.ordered(multiply(self.inner, z), d)

    def motion(
        self, full: AbstractSystem, t: Time, z: Float[Array, " r"], w: Float[Array, " r"]
    ) -> Motion:
        t = jnp.asarray(t, z.dtype)
        one = jnp.ones_like(t)

        def rate(t, z):  # type: ignore[no-untyped-def]
            return jax.jvp(lambda t, z: self.position(full, t, z), (t, z), (one, w))

        (q, v), (_, bias) = jax.jvp(rate, (t, z), (one, w))
        # Of the tangent, only the rows of d need a derivative.
        slopes = jax.jacfwd(lambda z: self._violation(full, t, z))(z)
        tangent = self.chart.ordered(self.inner, -multiply(self.inverse, slopes))
        return Motion(q, v, tangent, bias)

    def restrict(
        self, full: AbstractSystem, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        del full
        return multiply(self.dual, q - self.offset), multiply(self.dual, v)

    def with_full(self, full: AbstractSystem) -> Self:
        rows = self.chart.dependent_jacobian(full, self.time, self.offset)
        return eqx.tree_at(lambda lift: lift.inverse, self, jnp.linalg.inv(rows))

    def _violation(
        self, full: AbstractSystem, t: Time, z: Float[Array, " r"]
    ) -> Float[Array, " m"]:
        """The constraints where d is that of the guess."""
        if not self.chart.rows:
            return jnp.zeros(0, z.dtype)
        q = self.offset + self.chart.ordered(multiply(self.inner, z), self.guess)
        return self.chart.regular(full.constraint(t, q))
