"""The reduced system by d'Alembert's principle in the subspace."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from .base import AbstractSubspaceSystem
from .validity import Training


class GalerkinSystem(AbstractSubspaceSystem):
    """(ΦᵀMΦ) z̈ + (UᵀC_qΦ)ᵀ λ = ΦᵀQ with Uᵀ C(q̄ + Φz) = 0.

    What the chapter's equations 39.6 and 39.7 mean to be: the virtual work of the full equations
    vanishes in the subspace, so the energy balance survives. Of the constraints only those
    combinations U are kept that the basis can violate.
    """

    full: AbstractSystem
    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    combinations: Float[Array, "M m"]
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    training: Training | None
    reason: str = eqx.field(static=True)

    @property
    def m(self) -> int:
        return self.combinations.shape[1]

    def constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " m"]:
        if self.m == 0:
            return jnp.zeros(0, q.dtype)
        return multiply(self.combinations.T, self.full.constraint(t, self.lift(q)))

    def jacobian(self, t: Time, q: Float[Array, " r"]) -> Float[Array, "m r"]:
        if self.m == 0:
            return jnp.zeros((0, self.n), q.dtype)
        rows = multiply(self.combinations.T, self.full.jacobian(t, self.lift(q)))
        return multiply(rows, self.modes)

    def constraint_label(self, row: int) -> str:
        return f"kept combination {row + 1} of the constraints"
