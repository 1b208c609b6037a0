"""A hinge."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..marker import Marker, Pose
from ..outline import Outline, marks
from .base import AbstractJoint


class Revolute(AbstractJoint):
    """The two markers stay at one position (chapter equation 39.16); both bodies may turn."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("angle", "rad"),)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "2"]:
        del t
        return a.position - b.position

    def place(self, z: Float[Array, "1"]) -> Pose:
        return Pose(jnp.zeros(2, z.dtype), z[0])

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 3"]:
        return jnp.array([[1, 0, 0]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return (a.angle - b.angle)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses),)
