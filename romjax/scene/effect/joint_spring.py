"""A spring in a joint."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose
from ..motion import check_motion, moved
from .along_motion import AbstractMotionEffect
from .base import AbstractPotential, check_markers


class JointSpring(AbstractMotionEffect, AbstractPotential):
    """A spring against a motion s of two markers, with the energy ½ k (s − rest)².

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: k [N m/rad], or [N/m] of a length.
    - `rest`: s where the spring is free [rad], [m].
    - `motion`: what s is: "angle" about the z axis with full turns, "bounded angle" between −π and
      π, "travel" along the axis on which joints slide, "distance" of the points, or in space "1 of
      2", "2 of 2" and "1 of 3", "2 of 3", "3 of 3", the angles about x, then y, then z, of which
      each axis is turned by the angles before it.
    """

    a: Marker
    b: Marker
    stiffness: Converted[Float[Array, ""]] = number()
    rest: Converted[Float[Array, ""]] = number(default=0.0)
    motion: str = eqx.field(static=True, default="angle")

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        return 0.5 * self.stiffness * (moved(self.motion, *poses) - self.rest) ** 2

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        del t, rate
        return -self.stiffness * (value - self.rest)

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        check_numbers(owner, self, "stiffness", sign="not negative")
        check_numbers(owner, self, "rest")
