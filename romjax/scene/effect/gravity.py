"""Gravity."""

from jaxtyping import Array, Float

from ...arrays import Vector
from ..body.base import AbstractBody
from ..fields import Converted, check_numbers, number
from .base import AbstractField


class Gravity(AbstractField):
    """Uniform gravity on every body.

    **Arguments:**

    - `acceleration`: vector of the gravitational acceleration [m/s²]; down along −y unless given.
    """

    acceleration: Converted[Float[Array, "2"], Vector] = number(default=(0.0, -9.81))

    def energy(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, ""]:
        return -self.acceleration @ body.first_moment(q)

    def check(self) -> None:
        check_numbers("effect 'Gravity'", self, "acceleration", shape=(2,))
