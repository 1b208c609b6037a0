"""A pair of gears."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose
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
    offset: Converted[Float[Array, ""]] = number(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        del t
        return (a.angle - self.ratio * b.angle - self.offset)[None]

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "ratio", "offset")
