"""A point that slides along a line."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...arrays import Time
from ..drawing import rail
from ..marker import Marker, Pose
from ..outline import Outline
from .base import AbstractJoint


class PointOnLine(AbstractJoint):
    """Marker `a` stays on the local x axis of marker `b` (chapter equation 39.14); it may turn."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return b.across(a.position)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        return (
            Outline(rail(b, a.position, size), "track", endless=True),
            Outline(a.position[None], "hinge"),
        )
