"""Two bodies that keep their angle."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import placed
from ..fields import Converted, check_numbers, radians
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import AbstractJoint


class FixedAngle(AbstractJoint):
    """Marker `a` keeps the angle `value` [rad] against marker `b` (chapter equation 39.15).

    In space it is the angle about the z axis of `b`, after which `a` may tilt in any direction.
    """

    a: Marker
    b: Marker
    value: Converted[Float[Array, ""]] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    hatched: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def freedoms(self) -> tuple[tuple[str, str], ...] | None:  # type: ignore[override]
        return (("x", "m"), ("y", "m")) if self.b.dimension == 2 else None

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return a.angle_against(b, self.value)[None]

    def place(self, z: Float[Array, "2"]) -> Pose:
        return Pose(z, self.value)

    def screws(self, z: Float[Array, "2"]) -> Float[Array, "2 3"]:
        return jnp.array([[0, 1, 0], [0, 0, 1]], z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "2"]:
        return b.local(a.position)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        corner = np.array([(0.8, 0.0), (0.8, 0.8), (0.0, 0.8), (0, 0), (0.8, 0)]) * size
        return (Outline(placed(poses[0], corner), "link"),)

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "value")
