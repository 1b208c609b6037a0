"""A pair of gears."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Number, Time, as_array, concrete
from ...common.errors import SceneError
from ..counted_angle import counted_angle
from ..drawing import belt, length_between, wheel
from ..fields import check_numbers, number, radians
from ..marker import GROUND, Marker, Pose, Poses
from ..marker_checks import check_distinct
from ..outline import Outline, Outlines
from .base import AbstractJoint
from .revolute import Revolute

# How far a hinge may be from the middle of a wheel that it holds [m].
_TOUCHING = 1e-9


class Gear(AbstractJoint):
    """Wheel `a` turns `ratio` times as fast as wheel `b`: φ_a = `ratio` φ_b + `offset`.

    Each angle is against the bearing of the wheel: a marker on what carries it, which may move, as
    that of planets does. In space it is about the z axis, axes may have any direction, so that this
    is a pair of bevel or worm gears too, and angles count full turns from between −π and π at the
    start. Bearings are joints of their own. `Gear(a, b, ratio)` is short for wheels in the plane on
    the ground.

    **Arguments:**

    - `a`, `b`: on the wheels, in space with z along their axes.
    - `bearing_a`, `bearing_b`: on what carries each of them, in space with z in the same direction.
      In the plane one is enough where a body carries both, as an arm does the wheels of a belt, or
      holds their distance; the ground without any.
    - `ratio`: of the speeds; negative where the wheels turn in opposite senses, as where they mesh
      outside in the plane.
    - `offset`: φ_a where φ_b is zero [rad].

    Raises SceneError for a wheel in space without a bearing, and in a scene for one without, in the
    middle of which a hinge is on another body than the ground.
    """

    a: Marker
    b: Marker
    bearing_a: Marker | None
    bearing_b: Marker | None
    ratio: Float[Array, ""] = number()
    offset: Float[Array, ""] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 2), (1, 3))
    hatched: ClassVar[bool] = False

    def __init__(
        self,
        a: Marker,
        b: Marker,
        bearing_a: Marker | Number | None = None,
        bearing_b: Marker | None = None,
        ratio: Number | None = None,
        offset: Number = 0.0,
        name: str = "",
    ):
        if bearing_a is not None and not isinstance(bearing_a, Marker):
            bearing_a, ratio = None, bearing_a
        self.a, self.b, self.name = a, b, name
        self.bearing_a, self.bearing_b = bearing_a, bearing_b
        # In the plane one arm usually carries both wheels, so that one bearing is enough.
        if a.dimension == 2:
            self.bearing_a, self.bearing_b = bearing_a or bearing_b, bearing_b or bearing_a
        if ratio is None:
            raise SceneError(
                f"{self.owner()}: ratio is missing; give that of the speeds.", field="ratio"
            )
        self.ratio, self.offset = as_array(ratio), as_array(offset)

    @property
    def markers(self) -> tuple[Marker, ...]:
        given = (self.bearing_a, self.bearing_b)
        return (self.a, self.b, *(marker for marker in given if marker is not None))

    def residual(self, t: Time, a: Pose, b: Pose, *others: Pose) -> Float[Array, "1"]:
        del t
        if a.dimension == 3:
            bearing_a, bearing_b, counter_a, counter_b = others
            angle_a = counted_angle(a, bearing_a, counter_a)
            angle_b = counted_angle(b, bearing_b, counter_b)
        else:
            # In the plane angles are coordinates, which count full turns by themselves.
            angle_a, angle_b = a.angle, b.angle
            # Against the arm that carries the wheels, as in a planetary gear.
            if others:
                angle_a, angle_b = angle_a - others[0].angle, angle_b - others[1].angle
        return (angle_a - self.ratio * angle_b - self.offset)[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Pitch circles, which touch where axes are parallel and wheels mesh outside; in the plane
        else a belt.
        """
        del t
        a, b, *_ = poses
        apart = length_between(a.position, b.position)
        outside = (self.ratio < 0) | (a.dimension == 3)
        # Radii are as the inverse of the speeds; they add up to the distance of the axes where
        # wheels mesh outside.
        share = jnp.abs(self.ratio) / (1 + jnp.abs(self.ratio))
        total = jnp.where(apart > 0, jnp.where(outside, apart, 0.4 * apart), 2 * size)
        radii = total * (1 - share), total * share
        lines = [wheel(pose, radius) for pose, radius in zip((a, b), radii, strict=True)]
        if a.dimension == 2:
            sides = belt(a.position, b.position, radii)
            lines += [jnp.where(outside, a.position[None], side) for side in sides]
        return tuple(Outline(points, "link") for points in lines)

    def check(self) -> None:
        super().check()
        owner = self.owner()
        for turning, bearing, name in self._bearings():
            if bearing is not None and turning.body == bearing.body:
                raise SceneError(
                    f"{owner}: a wheel and its bearing are both on '{turning.body}'; give a marker "
                    "on what carries the wheel, or on the ground."
                )
            if bearing is None and turning.dimension == 3:
                raise SceneError(
                    f"{owner}: {name} is missing; in space give a marker on what carries "
                    f"'{turning.body}', or on the ground, with z along the axis of the wheel.",
                    field=name,
                )
        check_distinct(owner, self.a, self.b)
        check_numbers(owner, self, "ratio", "offset")

    def check_among(self, joints: Sequence[AbstractJoint]) -> None:
        for turning, bearing, name in self._bearings():
            carriers = _carriers(turning, joints)
            # A wheel on a moving arm that is counted against the ground is off by the turn of the
            # arm.
            if bearing is None and carriers and GROUND not in carriers:
                raise SceneError(
                    f"{self.owner()}: '{turning.body}' turns on '{carriers[0]}', but its angle is "
                    f"taken against the ground; give {name}, a marker on what carries the wheels.",
                    field=name,
                )

    def _bearings(self) -> tuple[tuple[Marker, Marker | None, str], ...]:
        return (self.a, self.bearing_a, "bearing_a"), (self.b, self.bearing_b, "bearing_b")


def _carriers(wheel: Marker, joints: Sequence[AbstractJoint]) -> list[str]:
    """The bodies on which hinges hold a wheel in its middle."""
    carriers, hub = [], concrete(wheel.point)
    for joint in joints:
        if not isinstance(joint, Revolute):
            continue
        for own, other in ((joint.a, joint.b), (joint.b, joint.a)):
            point = concrete(own.point) if own.body == wheel.body else None
            if hub is None or point is None:
                continue
            if not np.any(np.abs(point - hub) > _TOUCHING):
                carriers.append(other.body)
    return carriers
