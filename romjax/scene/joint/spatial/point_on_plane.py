"""A point that slides on a plane."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...drawing import placed, square
from ...marker import Marker, Pose, Poses
from ...outline import Outline, Outlines
from ..base import QUATERNION, AbstractJoint, turns_at


class PointOnPlane(AbstractJoint):
    """Marker `a` stays in the plane z = 0 of marker `b`; it may turn in any direction."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    at_points: ClassVar[tuple[int, ...]] = (0,)
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (
        ("x", "m"),
        ("y", "m"),
        *QUATERNION,
    )
    turns_freely: ClassVar[bool] = True

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return b.along(a.position)[None]

    def place(self, z: Float[Array, "6"]) -> Pose:
        return Pose(jnp.append(z[:2], 0), z[2:])

    def screws(self, z: Float[Array, "6"]) -> Float[Array, "5 6"]:
        moving = np.eye(6, dtype=z.dtype)[3:5]
        return jnp.concatenate([moving, turns_at(jnp.append(z[:2], 0))])

    def read(self, a: Pose, b: Pose) -> Float[Array, "6"]:
        relative = a.against(b)
        return jnp.append(relative.position[:2], relative.turn)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A square of the plane at the foot of `a`."""
        del t
        a, b = poses
        flat = placed(b, square(b.local(a.position), size))
        return Outline(flat, "track"), Outline(a.position[None], "point")
