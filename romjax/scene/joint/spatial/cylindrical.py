"""A joint that slides along an axis and turns about it."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose, Poses
from ...outline import Outlines
from ..base import AbstractJoint
from ..directions import about_z, angle_about_z, tilt
from ..sliding import sliding


class Cylindrical(AbstractJoint):
    """Marker `a` slides along the z axis of marker `b` and turns about it."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("travel", "m"), ("angle", "rad"))
    motions: ClassVar[tuple[str, ...]] = ("travel", "angle")

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        return jnp.concatenate([b.local(a.position)[:2], tilt(a, b)])

    def place(self, z: Float[Array, "2"]) -> Pose:
        return Pose(jnp.pad(z[:1], (2, 0)), about_z(z[1]))

    def screws(self, z: Float[Array, "2"]) -> Float[Array, "2 6"]:
        return jnp.array([[0, 0, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "2"]:
        return jnp.stack([b.along(a.position), angle_about_z(a, b)])

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        return sliding(Pose(a.position, b.turn), b, size)
