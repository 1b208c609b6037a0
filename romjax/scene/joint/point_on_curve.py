"""A point that slides along a curve."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..curve import AbstractCurve
from ..drawing import placed
from ..marker import Marker, Pose
from ..outline import Outline
from .base import AbstractJoint


class PointOnCurve(AbstractJoint):
    """Marker `a` stays on a `curve` in the frame of marker `b`, like `Circle` or `Polynomial`."""

    a: Marker
    b: Marker
    curve: AbstractCurve
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    at_points: ClassVar[tuple[int, ...]] = (0,)
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return self.curve(b.local(a.position))[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        track = placed(b, self.curve.outline(b.local(a.position), size))
        return (
            Outline(track, "track", endless=self.curve.endless),
            Outline(a.position[None], "hinge"),
        )

    def check(self) -> None:
        super().check()
        self.curve.check(self.owner())
