"""A point that slides along a curve."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...common.errors import SceneError
from ..curve import AbstractCurve, AbstractTrack
from ..drawing import placed
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import AbstractJoint


class PointOnCurve(AbstractJoint):
    """Marker `a` stays on a `curve` in the frame of marker `b`, like `Circle` or `Polynomial`; in
    space on a `Helix` or another one in space, or on one of the plane, which is then in the x–y
    plane of `b`.

    Raises SceneError for a curve in space between markers in the plane.
    """

    a: Marker
    b: Marker
    curve: AbstractTrack
    name: str = eqx.field(static=True, default="")
    at_points: ClassVar[tuple[int, ...]] = (0,)
    hatched: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return self.b.dimension - 1

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        point = b.local(a.position)
        if not isinstance(self.curve, AbstractCurve):
            return self.curve(point)
        if self.b.dimension == 2:
            return self.curve(point)[None]
        return jnp.stack([self.curve(point[:2]), point[2]])

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        point = b.local(a.position)
        own = point[:2] if isinstance(self.curve, AbstractCurve) else point
        track = placed(b, self.curve.outline(own, size))
        return (
            Outline(track, "track", endless=self.curve.endless),
            Outline(a.position[None], "hinge"),
        )

    def check(self) -> None:
        super().check()
        owner = self.owner()
        if self.b.dimension == 2 and not isinstance(self.curve, AbstractCurve):
            raise SceneError(
                f"{owner}: curve is a {type(self.curve).__name__}, a curve in space, but the "
                "markers are in the plane; give a curve of the plane, such as a Circle.",
                field="curve",
            )
        self.curve.check(owner)
