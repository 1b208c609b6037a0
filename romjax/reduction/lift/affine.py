"""The lift of an affine subspace."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...basis.turns import Turns
from ...common.arrays import Time
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from .base import AbstractLift, Motion, Physical, Reduced


class AffineLift(AbstractLift):
    """q = q̄ + Φ z; with `turns` of bodies in space, by quaternions of unit length along it.

    A subspace is flat, so that its quaternions change their lengths as bodies turn: a motion that
    the mechanism does not have, but that the mass matrix gives a kinetic energy.
    """

    modes: Float[Array, "n r"]  # Φ
    offset: Float[Array, " n"]  # q̄
    turns: Turns | None = None

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        del full, t
        flat = self.offset + multiply(self.modes, z)
        return flat if self.turns is None else self.turns.normalised(flat)

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        if self.turns is None:
            return Motion(self.position(full, t, z), multiply(self.modes, w), self.modes, None)
        flat = self.offset + multiply(self.modes, z)
        columns = jnp.concatenate([self.modes, multiply(self.modes, w)[:, None]], axis=1)
        # v is one more column, the last: the second derivative is along it.
        q, changes, bias = self.turns.normalised_motion(flat, columns)
        return Motion(q, changes[:, -1], changes[:, :-1], bias)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        """The nearest in the mass metric: ΦᵀMΦ z = ΦᵀM (q − q̄), and w alike."""
        weighted = full.mass(q) @ self.modes
        right = weighted.T @ jnp.stack([q - self.offset, v], axis=1)
        z = jnp.linalg.solve(self.modes.T @ weighted, right)
        return z[:, 0], z[:, 1]

    def with_full(self, full: AbstractSystem) -> "AffineLift":
        del full
        return self
