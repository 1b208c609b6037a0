"""A spring that turns."""

from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..counted_angle import counted_angle
from ..drawing import arc, placed
from ..fields import Converted, check_numbers, number, radians
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import AbstractPotential, check_markers


class TorsionSpring(AbstractPotential):
    """A torsional spring between two markers, with the energy ½ k (φ_a − φ_b − rest)².

    Angles count full turns; in space they are those about the z axis of the markers, between −π
    and π at the start. Markers that are made by an `axis` may have different x axes where the
    bodies are placed, from which `rest_angle` counts; those by a `rotation` have the axes that it
    says.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: k [N m/rad].
    - `rest_angle`: of `a` against `b` where the spring is free [rad].
    """

    a: Marker
    b: Marker
    stiffness: Converted[Float[Array, ""]] = number()
    rest_angle: Converted[Float[Array, ""]] = radians(default=0.0)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        return 0.5 * self.stiffness * (counted_angle(*poses) - self.rest_angle) ** 2

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A spiral from the x axis of `a` outwards, two turns more than the angle of both."""
        del t
        a, b = poses
        sweep = b.angle_against(a) + 4 * np.pi
        radius = size * np.linspace(0.2, 1.2, 61)
        return (Outline(placed(a, arc(radius, sweep, 61)), "spring"),)

    def check(self) -> None:
        owner = check_markers(self)
        check_numbers(owner, self, "stiffness", sign="not negative")
        check_numbers(owner, self, "rest_angle")
