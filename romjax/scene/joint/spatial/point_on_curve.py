"""A point that slides along a curve in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...curve import AbstractCurve
from ...drawing import placed
from ...marker import Marker, Pose
from ...outline import Outline
from ...space_curve import AbstractSpaceCurve
from ..base import AbstractJoint


class PointOnCurve(AbstractJoint):
    """Marker `a` stays on a `curve` in the frame of marker `b`: a `Helix` or another one in space,
    or one of the plane, such as `romjax.Circle`, which is then in the x–y plane of `b`.
    """

    a: Marker
    b: Marker
    curve: AbstractSpaceCurve | AbstractCurve
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2
    at_points: ClassVar[tuple[int, ...]] = (0,)
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "2"]:
        del t
        point = b.local(a.position)
        if isinstance(self.curve, AbstractCurve):
            return jnp.stack([self.curve(point[:2]), point[2]])
        return self.curve(point)

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        point = b.local(a.position)
        if isinstance(self.curve, AbstractCurve):
            track, endless = self.curve.outline(point[:2], size), self.curve.endless
        else:
            track, endless = self.curve.outline(point, size), True
        return (
            Outline(placed(b, track), "track", endless=endless),
            Outline(a.position[None], "hinge"),
        )

    def check(self) -> None:
        super().check()
        self.curve.check(self.owner())
