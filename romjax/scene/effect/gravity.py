"""Gravity."""

from jaxtyping import Array, Float

from ...common.arrays import Vector
from ...common.inheritance import goes_with
from ..body.base import AbstractBody
from ..body.bending import AbstractBendingBody
from ..fields import Converted, check_numbers, number
from .base import AbstractField


class Gravity(AbstractField):
    """Uniform gravity on every body.

    **Arguments:**

    - `acceleration`: vector of the gravitational acceleration [m/s²], of two numbers in the plane,
      of three in space; down along −y in the plane unless given.
    """

    acceleration: Converted[Float[Array, " d"], Vector] = number(default=(0.0, -9.81))

    def energy(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, ""]:
        return -self.acceleration @ body.first_moment(q)

    def force(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, " size"]:
        # A subclass may say the energy, or the moment of a body, alone.
        if (
            isinstance(body, AbstractBendingBody)
            and goes_with(self, "force", "energy")
            and goes_with(body, "first_moment_slope", "first_moment")
        ):
            return self.acceleration @ body.first_moment_slope(q)
        return super().force(body, q)

    def check(self) -> None:
        d = 3 if self.acceleration.shape == (3,) else 2
        check_numbers("effect 'Gravity'", self, "acceleration", shape=(d,))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.acceleration.shape[-1]
