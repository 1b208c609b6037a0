"""The lift of an affine subspace."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...arrays import Time
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from .base import AbstractLift, Motion, Physical, Reduced


class AffineLift(AbstractLift):
    """q = q̄ + Φ z."""

    modes: Float[Array, "n r"]  # Φ
    offset: Float[Array, " n"]  # q̄

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        del full, t
        return self.offset + multiply(self.modes, z)

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        return Motion(self.position(full, t, z), multiply(self.modes, w), self.modes, None)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        """The nearest in the mass metric: ΦᵀMΦ z = ΦᵀM (q − q̄), and w alike."""
        weighted = full.mass(q) @ self.modes
        right = weighted.T @ jnp.stack([q - self.offset, v], axis=1)
        z = jnp.linalg.solve(self.modes.T @ weighted, right)
        return z[:, 0], z[:, 1]

    def with_full(self, full: AbstractSystem) -> "AffineLift":
        del full
        return self
