"""A hinge in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...drawing import axis_line
from ...marker import Marker, Pose
from ...outline import Outline, marks
from ..base import AbstractJoint
from .directions import about_z, angle_about_z, tilt


class Revolute(AbstractJoint):
    """The two markers stay at one position and keep their z axes along each other: a hinge."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 5
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("angle", "rad"),)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "5"]:
        del t
        return jnp.concatenate([a.position - b.position, tilt(a, b)])

    def place(self, z: Float[Array, "1"]) -> Pose:
        return Pose(jnp.zeros(3, z.dtype), about_z(z[0]))

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 6"]:
        return jnp.array([[0, 0, 1, 0, 0, 0]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return angle_about_z(a, b)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """The axis; two marks at one position, unless the joint is torn."""
        del t
        return Outline(axis_line(poses[1], size), "link"), marks(poses)
