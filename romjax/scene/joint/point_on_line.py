"""A point that slides along a line."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import rail
from ..marker import Marker, Pose
from ..outline import Outline
from .base import AbstractJoint


class PointOnLine(AbstractJoint):
    """Marker `a` stays on the local x axis of marker `b` (chapter equation 39.14), in space on its
    z axis; it may turn.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    at_points: ClassVar[tuple[int, ...]] = (0,)
    hatched: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return self.b.dimension - 1

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        return jnp.atleast_1d(b.across(a.position))

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b = poses
        return (
            Outline(rail(b, a.position, size), "track", endless=True),
            Outline(a.position[None], "hinge"),
        )
