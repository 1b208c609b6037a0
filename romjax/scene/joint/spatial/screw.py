"""A screw."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...counted_angle import counted_angle
from ...fields import Converted, check_numbers, number
from ...marker import Marker, Pose, Poses
from ...outline import Outlines
from ..base import AbstractJoint
from ..directions import about_z, angle_about_z, tilt
from ..sliding import sliding


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
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("angle", "rad"),)

    def residual(self, t: Time, a: Pose, b: Pose, *counter: Pose) -> Float[Array, "5"]:
        del t
        local = b.local(a.position)
        advance = self.pitch * counted_angle(a, b, *counter) / (2 * np.pi) + self.offset
        return jnp.concatenate([local[:2], tilt(a, b), (local[2] - advance)[None]])

    def place(self, z: Float[Array, "1"]) -> Pose:
        advance = self.pitch * z / (2 * np.pi) + self.offset
        return Pose(jnp.pad(advance, (2, 0)), about_z(z[0]))

    def screws(self, z: Float[Array, "1"]) -> Float[Array, "1 6"]:
        turning = np.eye(6, dtype=z.dtype)[2]
        return jnp.append(turning[:5], self.pitch / (2 * np.pi))[None]

    def read(self, a: Pose, b: Pose) -> Float[Array, "1"]:
        """The number of full turns is that of the travel."""
        angle, turn = angle_about_z(a, b), 2 * np.pi
        # Without a pitch the travel tells no turns.
        pitch = jnp.where(self.pitch == 0, jnp.inf, self.pitch)
        turns = (b.along(a.position) - self.offset) / pitch - angle / turn
        return (angle + turn * jax.lax.stop_gradient(jnp.round(turns)))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b, *_ = poses
        return sliding(a, b, size)

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "pitch", "offset")
