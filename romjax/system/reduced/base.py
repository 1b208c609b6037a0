"""What all reduced systems share: the way back to physical coordinates."""

import equinox as eqx
from jaxtyping import Array, Float

from ...scene.fields import Time
from ..base import AbstractSystem, Frequencies


class AbstractReducedSystem(AbstractSystem):
    """A system in the coordinates z of an affine subspace, q = q̄ + Φ z.

    A reduced system is a system: it simulates, compares and differentiates like any other.
    """

    full: eqx.AbstractVar[AbstractSystem]
    modes: eqx.AbstractVar[Float[Array, "n r"]]
    offset: eqx.AbstractVar[Float[Array, " n"]]
    reason: eqx.AbstractVar[str]  # what was kept, and what freedom is left, in words

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates that the constraints leave free, r − m."""
        return self.n - self.m

    def lift(self, q: Float[Array, " r"]) -> Float[Array, " n"]:
        """Physical coordinates q̄ + Φ z."""
        return self.offset + self.modes @ q

    def mass(self, q: Float[Array, " r"]) -> Float[Array, "r r"]:
        """ΦᵀMΦ."""
        return self.modes.T @ self.full.momentum(self.lift(q), self.modes)

    def force(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Float[Array, " r"]:
        """ΦᵀQ."""
        return self.modes.T @ self.full.force(t, self.lift(q), self.modes @ v)

    def coordinate_labels(self) -> tuple[str, ...]:
        return self.full.coordinate_labels()

    def physical(
        self, q: Float[Array, " r"], v: Float[Array, " r"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        return self.lift(q), self.modes @ v

    def physical_metric(self) -> Float[Array, "n n"]:
        return self.full.physical_metric()

    def physical_constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " M"]:
        return self.full.physical_constraint(t, self.lift(q))

    def frequencies(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Frequencies:
        """Its own fastest frequency, and the rigid one of the full system: z knows no bodies."""
        full = self.full.frequencies(t, *self.physical(q, v))
        return Frequencies(full.rigid, super().frequencies(t, q, v).fastest)
