"""A ball joint."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose, Poses
from ...outline import Outlines, marks
from ..base import QUATERNION, AbstractJoint, turns_at


class Spherical(AbstractJoint):
    """The two markers stay at one position; both bodies may turn about it in any direction."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 3
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = QUATERNION
    turns_freely: ClassVar[bool] = True

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "3"]:
        del t
        return a.position - b.position

    def place(self, z: Float[Array, "4"]) -> Pose:
        return Pose(jnp.zeros(3, z.dtype), z)

    def screws(self, z: Float[Array, "4"]) -> Float[Array, "3 6"]:
        return turns_at(jnp.zeros(3, z.dtype))

    def read(self, a: Pose, b: Pose) -> Float[Array, "4"]:
        return a.against(b).turn

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses),)
