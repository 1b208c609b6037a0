"""A rigid connection."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, radians
from ..marker import Marker, Pose
from ..outline import Outline, marks
from .base import AbstractJoint


class Weld(AbstractJoint):
    """Marker `a` stays at the position of marker `b`, at the angle `value` [rad] against it."""

    a: Marker
    b: Marker
    value: Converted[Float[Array, ""]] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 3
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = ()

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "3"]:
        del t
        return jnp.append(a.position - b.position, a.angle - b.angle - self.value)

    def place(self, z: Float[Array, "0"]) -> Pose:
        return Pose(jnp.zeros(2, z.dtype), self.value)

    def screws(self, z: Float[Array, "0"]) -> Float[Array, "0 3"]:
        return jnp.zeros((0, 3), z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "0"]:
        del b
        return jnp.zeros(0, a.position.dtype)

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses, "weld"),)

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "value")
