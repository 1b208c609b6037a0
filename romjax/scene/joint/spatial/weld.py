"""A rigid connection in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose
from ...outline import Outline, marks
from ..base import AbstractJoint
from .directions import about_z, turned


class Weld(AbstractJoint):
    """The two markers stay at one position, and their axes parallel."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 6
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = ()

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "6"]:
        del t
        return jnp.concatenate([a.position - b.position, turned(a, b)])

    def place(self, z: Float[Array, "0"]) -> Pose:
        none = jnp.zeros(4, z.dtype)
        return Pose(none[:3], about_z(none[3]))

    def screws(self, z: Float[Array, "0"]) -> Float[Array, "0 6"]:
        return jnp.zeros((0, 6), z.dtype)

    def read(self, a: Pose, b: Pose) -> Float[Array, "0"]:
        del b
        return jnp.zeros(0, a.position.dtype)

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses, "weld"),)
