"""How the constraints are kept in an index-one system."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.arrays import Number, Vector
from ..common.fields import Converted, number
from ..common.plain import plain


class Baumgarte(eqx.Module):
    """Baumgarte stabilisation C̈ + α Ċ + β C = 0.

    Mind the convention: other codes write 2α and β². Critically damped at β = α²/4, where a
    violation decays like e^(−αt/2). An explicit method needs hα/2 below its real stability limit
    (Dopri5 3.3, Tsit5 3.5), and for accuracy hα/2 ≲ 0.03: larger values lower the order.

    **Arguments:**

    - `alpha` [1/s], `beta` [1/s²]: one number, or one per constraint.
    """

    alpha: Converted[Float[Array, "*m"], Vector] = number()
    beta: Converted[Float[Array, "*m"], Vector] = number()

    def __repr__(self) -> str:
        return plain(self)

    @classmethod
    def critical(cls, omega: Number) -> "Baumgarte":
        """Critical damping with the frequency `omega` [rad/s]: α = 2ω, β = ω²."""
        # s² + α s + β has the double root −ω.
        return cls(alpha=2 * jnp.asarray(omega), beta=jnp.asarray(omega) ** 2)

    def term(self, violation: Float[Array, " m"], rate: Float[Array, " m"]) -> Float[Array, " m"]:
        """α Ċ + β C."""
        return self.alpha * rate + self.beta * violation


class Projection(eqx.Module):
    """Projection of every step and every saved point to C = 0 and Ċ = 0, in the mass metric.

    No parameter to tune and no drift: |C| stays at rounding level for any simulated time.

    **Arguments:**

    - `sweeps`: Gauss–Newton sweeps for the positions; two reach rounding from a step's error.
    """

    sweeps: int = eqx.field(static=True, default=2)


# How constraints are kept; None: not at all, they drift.
Stabilization = Baumgarte | Projection | None
