"""A damper that turns."""

from jaxtyping import Array, Float

from ..fields import Time, check_finite, check_not_negative, check_shape, number
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
    damping: Float[Array, ""] = number()

    def __check_init__(self) -> None:
        self.check()

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (self.a, self.b)

    def rayleigh(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> Float[Array, ""]:
        del t, poses
        a, b = twists
        return 0.5 * self.damping * (a.angular_velocity - b.angular_velocity) ** 2

    def check(self) -> None:
        owner = check_markers(self)
        check_shape(owner, "damping", self.damping, ())
        check_finite(owner, "damping", self.damping)
        check_not_negative(owner, "damping", self.damping)
