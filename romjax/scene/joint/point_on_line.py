"""A point that slides along a line."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...arrays import Time
from ..marker import Marker, Pose
from .base import AbstractJoint


class PointOnLine(AbstractJoint):
    """Marker `a` stays on the local x axis of marker `b` (chapter equation 39.14); it may turn."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return b.across(a.position)[None]
