"""Aerodynamic drag."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...linalg.dense import length
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Poses, Twists
from ..outline import Outline, Outlines
from .base import AbstractDissipation, check_markers


class Drag(AbstractDissipation):
    """The resistance ½ ρ c A |v| v against the velocity v of a marker in a fluid at rest, the same
    in all directions, as that of a ball; R = ρ c A |v|³ / 6.

    **Arguments:**

    - `at`: the marker it acts on.
    - `coefficient`: c, such as 0.47 of a ball.
    - `area`: A [m²]. `density`: ρ of the fluid [kg/m³]; that of air unless given.
    """

    at: Marker
    coefficient: Converted[Float[Array, ""]] = number()
    area: Converted[Float[Array, ""]] = number()
    # Air at 15 °C and 1013 hPa, as the standard atmosphere has it at sea level.
    density: Converted[Float[Array, ""]] = number(default=1.225)
    at_points: ClassVar[tuple[int, ...]] = (0,)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def rayleigh(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        del t, poses
        velocity = twists[0].velocity
        # The force is −∂R/∂v = −½ ρ c A |v| v.
        return (
            self.density
            * self.coefficient
            * self.area
            * jnp.sum(velocity**2)
            * length(velocity)
            / 6
        )

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t, size
        return (Outline(poses[0].position[None], "point"),)

    def check(self) -> None:
        fields = ("coefficient", "area", "density")
        check_numbers(check_markers(self), self, *fields, sign="not negative")
