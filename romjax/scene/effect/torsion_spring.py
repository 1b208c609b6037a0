"""A spring that turns."""

from jaxtyping import Array, Float

from ..fields import Time, check_finite, check_not_negative, check_shape, number
from ..marker import Marker, Pose
from .base import AbstractPotential, check_markers


class TorsionSpring(AbstractPotential):
    """A torsional spring between two markers, with the energy ½ k (φ_a − φ_b − rest)².

    Angles count full turns.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: k [N m/rad].
    - `rest_angle`: of `a` against `b` where the spring is free [rad].
    """

    a: Marker
    b: Marker
    stiffness: Float[Array, ""] = number()
    rest_angle: Float[Array, ""] = number(0.0)

    def __check_init__(self) -> None:
        self.check()

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (self.a, self.b)

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        a, b = poses
        return 0.5 * self.stiffness * (a.angle - b.angle - self.rest_angle) ** 2

    def check(self) -> None:
        owner = check_markers(self)
        for field in ("stiffness", "rest_angle"):
            check_shape(owner, field, getattr(self, field), ())
            check_finite(owner, field, getattr(self, field))
        check_not_negative(owner, "stiffness", self.stiffness)
