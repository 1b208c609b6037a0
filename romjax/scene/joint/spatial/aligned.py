"""Axes that stay parallel, or at a right angle, wherever the points go."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...drawing import axis_line
from ...marker import Marker, Pose, Poses
from ...outline import Outline, Outlines
from ..base import AbstractJoint
from ..directions import axis, tilt, turned


class AbstractAligned(AbstractJoint):
    """The base of joints that hold directions, and no positions."""

    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The z axes of both."""
        del t
        return tuple(Outline(axis_line(pose, size), "link") for pose in poses)


class Untwisted(AbstractAligned):
    """All axes of the two markers stay parallel: no turn, any position."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 3

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "3"]:
        del t
        return turned(a, b)


class ParallelAxes(AbstractAligned):
    """The z axes of the two markers stay parallel: a turn about them, any position."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "2"]:
        del t
        return tilt(a, b)


class RightAngle(AbstractAligned):
    """The z axes of the two markers stay at a right angle, at any position: the turns of a
    universal joint.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return jnp.sum(axis(a, 2) * axis(b, 2))[None]
