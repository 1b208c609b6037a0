"""Gravity."""

from jaxtyping import Array, Float

from ..body.base import AbstractBody
from ..fields import check_finite, check_shape, number
from .base import AbstractField


class Gravity(AbstractField):
    """Uniform gravity on every body.

    **Arguments:**

    - `acceleration`: vector of the gravitational acceleration [m/s²]; down along −y unless given.
    """

    acceleration: Float[Array, "2"] = number((0.0, -9.81))

    def __check_init__(self) -> None:
        self.check()

    def energy(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, ""]:
        return -self.acceleration @ body.first_moment(q)

    def check(self) -> None:
        check_shape("effect 'Gravity'", "acceleration", self.acceleration, (2,))
        check_finite("effect 'Gravity'", "acceleration", self.acceleration)
