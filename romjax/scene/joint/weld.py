"""A rigid connection."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Number, Time
from ..fields import Converted, check_numbers, radians
from ..marker import Marker, Pose, Poses
from ..outline import Outlines, marks
from .base import AbstractJoint
from .directions import about_axis, drop_angle, turned


class Weld(AbstractJoint):
    """Marker `a` stays at the position of marker `b`, at the angle `value` [rad] against it; in
    space all axes of both stay parallel.
    """

    a: Marker
    b: Marker
    value: Converted[Float[Array, ""] | None, Number] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = ()

    def __post_init__(self) -> None:
        drop_angle(self)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return 3 if self.b.dimension == 2 else 6

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        apart = a.position - b.position
        if self.value is None:
            return jnp.concatenate([apart, turned(a, b)])
        return jnp.append(apart, a.angle - b.angle - self.value)

    def place(self, z: Float[Array, "0"]) -> Pose:
        if self.value is None:
            return Pose(jnp.zeros(3, z.dtype), about_axis(jnp.zeros((), z.dtype), 3))
        return Pose(jnp.zeros(2, z.dtype), self.value)

    def screws(self, z: Float[Array, "0"]) -> Float[Array, "0 twist"]:
        return jnp.zeros((0, 3 if self.b.dimension == 2 else 6), z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "0"]:
        del b
        return jnp.zeros(0, a.position.dtype)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses, "weld"),)

    def check(self) -> None:
        super().check()
        if self.b.dimension == 2:
            check_numbers(self.owner(), self, "value")
