"""A slide."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, radians
from ..marker import Marker, Pose
from ..outline import Outline
from .base import AbstractJoint
from .sliding import sliding


class Prismatic(AbstractJoint):
    """Marker `a` slides along the local x axis of marker `b` and keeps the angle `value` [rad]."""

    a: Marker
    b: Marker
    value: Converted[Float[Array, ""]] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2
    hatched: ClassVar[bool] = False
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("travel", "m"),)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "2"]:
        del t
        return jnp.stack([b.across(a.position), a.angle - b.angle - self.value])

    def place(self, z: Float[Array, "1"]) -> Pose:
        return Pose(jnp.append(z, 0), self.value)

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 3"]:
        return jnp.array([[0, 1, 0]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        return b.along(a.position)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        return sliding(Pose(a.position, a.angle - self.value), b, size)

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "value")
