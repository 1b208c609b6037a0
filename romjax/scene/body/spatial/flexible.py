"""The base of bodies in space with inertia invariants."""

import abc

from jaxtyping import Array, Float

from ..base import AbstractBody, flexible_start
from .frame_inverse import FrameInverse
from .inertia import SpatialInertia


class AbstractFlexibleBody(AbstractBody):
    """A body in space whose inertia is a `SpatialInertia`."""

    @abc.abstractmethod
    def invariants(self) -> SpatialInertia:
        """Return the inertia invariants of the mass matrix."""

    @property
    def constant_mass(self) -> bool:
        return False

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return flexible_start(self)

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size size"]:
        return self.invariants().matrix(q)

    def inverse_mass(self, q: Float[Array, " size"]) -> FrameInverse:
        return self.invariants().inverse(q)

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"]:
        return self.invariants().quadratic_velocity_force(q, v)

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "3"]:
        return self.invariants().first_moment_at(q)
