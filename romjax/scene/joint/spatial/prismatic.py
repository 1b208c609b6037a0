"""A slider in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose
from ...outline import Outline
from ..base import AbstractJoint
from ..sliding import sliding
from .directions import about_z, turned


class Prismatic(AbstractJoint):
    """Marker `a` slides along the z axis of marker `b`; their axes stay parallel."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 5
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("travel", "m"),)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "5"]:
        del t
        return jnp.concatenate([b.local(a.position)[:2], turned(a, b)])

    def place(self, z: Float[Array, "1"]) -> Pose:
        return Pose(jnp.pad(z, (2, 0)), about_z(jnp.zeros_like(z[0])))

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 6"]:
        return jnp.array([[0, 0, 0, 0, 0, 1]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return b.along(a.position)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        return sliding(a, b, size)
