"""A pair of gears."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...arrays import Time
from ..drawing import belt, length_between, wheel
from ..fields import Converted, check_numbers, number, radians
from ..marker import Marker, Pose
from ..outline import Outline
from .base import AbstractJoint


class Gear(AbstractJoint):
    """Marker `a` turns `ratio` times as fast as marker `b`, with φ_a = `ratio` φ_b + `offset`.

    The ratio is negative where gears mesh outside, positive inside or over a belt. Both wheels turn
    on bearings of their own that hold the distance of their axes; where these sit on the ground or
    on a body that does not turn, angles against the ground are those of the wheels.
    """

    a: Marker
    b: Marker
    ratio: Converted[Float[Array, ""]] = number()
    offset: Converted[Float[Array, ""]] = radians(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return (a.angle - self.ratio * b.angle - self.offset)[None]

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """Pitch circles that touch where wheels mesh outside, else a belt."""
        del t
        a, b = poses
        apart = length_between(a.position, b.position)
        outside = self.ratio < 0
        total = jnp.where(apart > 0, jnp.where(outside, apart, 0.4 * apart), 2 * size)
        share = jnp.abs(self.ratio) / (1 + jnp.abs(self.ratio))
        radii = total * (1 - share), total * share
        belts = [
            jnp.where(outside, a.position[None], side)
            for side in belt(a.position, b.position, radii)
        ]
        wheels = [wheel(pose, radius) for pose, radius in zip(poses, radii, strict=True)]
        return tuple(Outline(points, "link") for points in (*wheels, *belts))

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "ratio", "offset")
