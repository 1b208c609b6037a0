"""A hinge."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import axis_line
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines, marks
from .base import AbstractJoint
from .directions import TURNING, about_axis, angle_about_axis, tilt


class Revolute(AbstractJoint):
    """The two markers stay at one position (chapter equation 39.16), and both bodies may turn; in
    space about their z axes, which stay along each other.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("angle", "rad"),)
    motions: ClassVar[tuple[str, ...]] = ("angle",)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return 2 if self.b.dimension == 2 else 5

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return (0, 1) if self.b.dimension == 2 else ()

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        apart = a.position - b.position
        return apart if a.dimension == 2 else jnp.concatenate([apart, tilt(a, b)])

    def place(self, z: Float[Array, "1"]) -> Pose:
        dimension = self.b.dimension
        return Pose(jnp.zeros(dimension, z.dtype), about_axis(z[0], dimension))

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 twist"]:
        return jnp.array([TURNING[self.b.dimension]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return angle_about_axis(a, b)[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Two marks at one position, unless the joint is torn; in space the axis too."""
        del t
        axis = [Outline(axis_line(poses[1], size), "link")] if self.b.dimension == 3 else []
        return *axis, marks(poses)
