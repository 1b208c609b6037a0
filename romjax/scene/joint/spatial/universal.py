"""A universal joint."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...drawing import axis_line
from ...marker import Marker, Pose
from ...outline import Outline, marks
from ..base import AbstractJoint
from .directions import axis


class Universal(AbstractJoint):
    """The two markers stay at one position, and their z axes at a right angle: the two axes of a
    Cardan's cross.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        return jnp.append(a.position - b.position, jnp.sum(axis(a, 2) * axis(b, 2)))

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """The cross of both axes."""
        del t
        cross = [Outline(axis_line(pose, size), "link") for pose in poses]
        return *cross, marks(poses)
