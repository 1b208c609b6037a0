"""A damper that turns."""

from jaxtyping import Array, Float

from ...arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Twist
from .base import AbstractDissipation, check_markers


class TorsionDamper(AbstractDissipation):
    """A viscous damper against turning of two markers: R = ½ d (ω_a − ω_b)².

    **Arguments:**

    - `a`, `b`: the two ends.
    - `damping`: d [N m s/rad].
    """

    a: Marker
    b: Marker
    damping: Converted[Float[Array, ""]] = number()

    def rayleigh(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> Float[Array, ""]:
        del t, poses
        a, b = twists
        return 0.5 * self.damping * (a.angular_velocity - b.angular_velocity) ** 2

    def check(self) -> None:
        check_numbers(check_markers(self), self, "damping", sign="not negative")
