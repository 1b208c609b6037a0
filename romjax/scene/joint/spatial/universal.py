"""A universal joint."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Time
from ....linalg import quaternions
from ...drawing import axis_line
from ...marker import Marker, Pose, Poses
from ...outline import Outline, Outlines, marks
from ..base import AbstractJoint
from ..directions import about_z, angle_about_z, axis


class Universal(AbstractJoint):
    """The two markers stay at one position, and their z axes at a right angle: the two axes of a
    Cardan's cross.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (
        ("angle of b", "rad"),
        ("angle of a", "rad"),
    )

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        return jnp.append(a.position - b.position, jnp.sum(axis(a, 2) * axis(b, 2)))

    def place(self, z: Float[Array, "2"]) -> Pose:
        """The pose by Cardan's cross: `a` turns about its own z axis, the cross about `b`'s."""
        cross = quaternions.product(about_z(z[0]), _quarter(z.dtype))
        return Pose(jnp.zeros(3, z.dtype), quaternions.product(cross, about_z(z[1])))

    def screws(self, z: Float[Array, "2"]) -> Float[Array, "2 6"]:
        # The z axis of the cross: −y of b, turned by the first angle.
        second = jnp.pad(jnp.stack([jnp.sin(z[0]), -jnp.cos(z[0])]), (0, 4))
        return jnp.stack([np.eye(6, dtype=z.dtype)[2], second])

    def read(self, a: Pose, b: Pose) -> Float[Array, "2"]:
        relative = a.against(b)
        z = axis(relative, 2)
        # At the first angle φ it is the second axis of the cross as well, (sin φ, −cos φ, 0).
        first = jnp.arctan2(z[0], -z[1])
        cross = quaternions.product(about_z(first), _quarter(z.dtype))
        second = angle_about_z(relative, Pose(relative.position, cross))
        return jnp.stack([first, second])

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The cross of both axes."""
        del t
        cross = [Outline(axis_line(pose, size), "link") for pose in poses]
        return *cross, marks(poses)


def _quarter(dtype: Any) -> Float[Array, "4"]:
    """The quaternion, of unit length, of a quarter turn about the x axis."""
    return jnp.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0], dtype)
