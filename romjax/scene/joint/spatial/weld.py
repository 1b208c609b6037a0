"""A rigid connection in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose
from ...outline import Outline, marks
from ..base import AbstractJoint
from .directions import turned


class Weld(AbstractJoint):
    """The two markers stay at one position, and their axes parallel."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 6
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "6"]:
        del t
        return jnp.concatenate([a.position - b.position, turned(a, b)])

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Two marks at one position, unless the joint is torn."""
        del t, size
        return (marks(poses, "weld"),)
