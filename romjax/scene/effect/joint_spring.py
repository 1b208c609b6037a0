"""A spring in a joint."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose
from ..motion import check_motion, counts, is_limited, limit_of, moved, points_of
from .base import AbstractPotential, check_markers


class JointSpring(AbstractPotential):
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
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def counted(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]
        return counts(self.motion)

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return points_of(self.motion)

    @property
    def limited(self) -> bool:  # type: ignore[override]
        return is_limited(self.motion)

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """Return where three angles are told apart no more: a number that changes its sign."""
        return limit_of(self.motion, *poses)

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        return 0.5 * self.stiffness * (moved(self.motion, *poses) - self.rest) ** 2

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        check_numbers(owner, self, "stiffness", sign="not negative")
        check_numbers(owner, self, "rest")
