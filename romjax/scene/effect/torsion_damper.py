"""A damper that turns."""

from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import arc, placed
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists
from ..outline import Outline, Outlines
from .base import AbstractDissipation, check_markers


class TorsionDamper(AbstractDissipation):
    """A viscous damper against turning of two markers: R = ½ d (ω_a − ω_b)², in space about the z
    axis of `b`.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `damping`: d [N m s/rad].
    """

    a: Marker
    b: Marker
    damping: Converted[Float[Array, ""]] = number()
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def rayleigh(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        del t
        a, b = twists
        speed = poses[1].about(a.angular_velocity - b.angular_velocity)
        return 0.5 * self.damping * speed**2

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A ring around a vane that turns with `a`."""
        del t
        a, b = poses
        vane = placed(a, np.array([(-0.7, 0.0), (0.7, 0.0)]) * size)
        ring = placed(Pose(a.position, b.turn), arc(0.9 * size, 2 * np.pi))
        return Outline(ring, "damper"), Outline(vane, "damper")

    def check(self) -> None:
        check_numbers(check_markers(self), self, "damping", sign="not negative")
