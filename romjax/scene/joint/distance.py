"""A rigid link without mass."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import AbstractJoint


class Distance(AbstractJoint):
    """The two markers keep the distance `length` [m]; both bodies may turn.

    The residual (|d|² − L²) / 2L is smooth for all d, and a small one is the error of the length.
    """

    a: Marker
    b: Marker
    length: Converted[Float[Array, ""]] = number()
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        d = a.position - b.position
        return ((d @ d - self.length**2) / (2 * self.length))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t, size
        points = jnp.stack([pose.position for pose in poses])
        return Outline(points, "link"), Outline(points, "hinge")

    def check(self) -> None:
        super().check()
        remedy = "Two markers in one place are a Revolute."
        check_numbers(self.owner(), self, "length", sign="positive", remedy=remedy)
