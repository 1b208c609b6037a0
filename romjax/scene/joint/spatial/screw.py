"""A screw."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...counted_angle import counted_angle
from ...fields import Converted, check_numbers, number
from ...marker import Marker, Pose
from ...outline import Outline
from ..base import AbstractJoint
from ..sliding import sliding
from .directions import tilt


class Screw(AbstractJoint):
    """Marker `a` turns about the z axis of marker `b` and moves along it by `pitch` [m] a turn.

    With the angle φ, which counts full turns and is between −π and π at the start, `a` is at
    z = pitch φ / 2π + offset.

    **Arguments:**

    - `a`, `b`: the bolt and the nut.
    - `pitch`: of a turn [m]; positive for a screw with a right-hand thread.
    - `offset`: z where the angle is zero [m].
    """

    a: Marker
    b: Marker
    pitch: Converted[Float[Array, ""]] = number()
    offset: Converted[Float[Array, ""]] = number(default=0.0)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 5
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    hatched: ClassVar[bool] = False

    def residual(self, t: Time, a: Pose, b: Pose, *counter: Pose) -> Float[Array, "5"]:
        del t
        local = b.local(a.position)
        advance = self.pitch * counted_angle(a, b, *counter) / (2 * np.pi) + self.offset
        return jnp.concatenate([local[:2], tilt(a, b), (local[2] - advance)[None]])

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        del t
        a, b, *_ = poses
        return sliding(a, b, size)

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "pitch", "offset")
