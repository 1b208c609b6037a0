"""A pair of gears in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....arrays import Time
from ....errors import SceneError
from ...counted_angle import counted_angle
from ...drawing import length_between, wheel
from ...fields import Converted, check_numbers, number, radians
from ...marker import Marker, Pose, check_distinct
from ...outline import Outline
from ..base import AbstractJoint


class Gear(AbstractJoint):
    """Wheel `a` turns `ratio` times as fast as wheel `b`: φ_a = `ratio` φ_b + `offset`.

    Each angle is about the z axis, against the bearing of the wheel: a marker on what carries it,
    which may move, as that of planets does. Axes may have any direction, so this is a pair of bevel
    or worm gears too. Bearings are joints of their own. Angles count full turns, and are between −π
    and π at the start.

    **Arguments:**

    - `a`, `b`: on the wheels, with z along their axes.
    - `bearing_a`, `bearing_b`: on what carries each of them, with z in the same direction.
    - `ratio`: of the speeds; negative where the wheels turn in opposite senses about their z axes.
    - `offset`: φ_a where φ_b is zero [rad].
    """

    a: Marker
    b: Marker
    bearing_a: Marker
    bearing_b: Marker
    ratio: Converted[Float[Array, ""]] = number()
    offset: Converted[Float[Array, ""]] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 2), (1, 3))
    hatched: ClassVar[bool] = False

    @property
    def markers(self) -> tuple[Marker, ...]:
        return self.a, self.b, self.bearing_a, self.bearing_b

    def residual(self, t: Time, a: Pose, b: Pose, *others: Pose) -> Float[Array, "1"]:
        del t
        bearing_a, bearing_b, counter_a, counter_b = others
        angle_a = counted_angle(a, bearing_a, counter_a)
        angle_b = counted_angle(b, bearing_b, counter_b)
        return (angle_a - self.ratio * angle_b - self.offset)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Pitch circles that touch where the axes are parallel and the wheels mesh outside."""
        del t
        share = jnp.abs(self.ratio) / (1 + jnp.abs(self.ratio))
        apart = length_between(poses[0].position, poses[1].position)
        total = jnp.where(apart > 0, apart, 2 * size)
        radii = total * (1 - share), total * share
        return tuple(
            Outline(wheel(pose, r), "link") for pose, r in zip(poses[:2], radii, strict=True)
        )

    def check(self) -> None:
        super().check()
        owner = self.owner()
        for turning, bearing in ((self.a, self.bearing_a), (self.b, self.bearing_b)):
            if turning.body == bearing.body:
                raise SceneError(
                    f"{owner}: a wheel and its bearing are both on '{turning.body}'; give a marker "
                    "on what carries the wheel, or on the ground."
                )
        check_distinct(owner, self.a, self.b)
        check_numbers(owner, self, "ratio", "offset")
