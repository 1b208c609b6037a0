"""A slide."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Number, Time
from ..fields import Converted, check_numbers, radians
from ..marker import Marker, Pose, Poses
from ..outline import Outlines
from .base import AbstractJoint
from .directions import SLIDING, about_axis, drop_angle, turned
from .sliding import sliding


class Prismatic(AbstractJoint):
    """Marker `a` slides along the local x axis of marker `b` and keeps the angle `value` [rad]; in
    space it slides along z, and all axes stay parallel.
    """

    a: Marker
    b: Marker
    value: Converted[Float[Array, ""] | None, Number] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    hatched: ClassVar[bool] = False
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("travel", "m"),)
    motions: ClassVar[tuple[str, ...]] = ("travel",)

    def __post_init__(self) -> None:
        drop_angle(self)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return 2 if self.b.dimension == 2 else 5

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        if self.value is None:
            return jnp.concatenate([b.across(a.position), turned(a, b)])
        return jnp.stack([b.across(a.position), a.angle - b.angle - self.value])

    def place(self, z: Float[Array, "1"]) -> Pose:
        if self.value is None:
            return Pose(jnp.pad(z, (2, 0)), about_axis(jnp.zeros_like(z[0]), 3))
        return Pose(jnp.append(z, 0), self.value)

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 twist"]:
        return jnp.array([SLIDING[self.b.dimension]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return b.along(a.position)[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        return sliding(a if self.value is None else Pose(a.position, a.angle - self.value), b, size)

    def check(self) -> None:
        super().check()
        if self.b.dimension == 2:
            check_numbers(self.owner(), self, "value")
