"""A joint that slides along an axis and turns about it."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...marker import Marker, Pose
from ...outline import Outline
from ..base import AbstractJoint
from ..sliding import sliding
from .directions import tilt


class Cylindrical(AbstractJoint):
    """Marker `a` slides along the z axis of marker `b` and turns about it."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        return jnp.concatenate([b.local(a.position)[:2], tilt(a, b)])

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        return sliding(Pose(a.position, b.turn), b, size)
