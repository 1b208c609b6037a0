"""A joint that slides on a plane."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Time
from ...drawing import placed, square
from ...marker import Marker, Pose, Poses
from ...outline import Outline, Outlines
from ..base import AbstractJoint, turns_at
from ..directions import about_z, angle_about_z, tilt


class Planar(AbstractJoint):
    """Marker `a` stays in the plane z = 0 of marker `b`, and turns about its normal."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 3
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    hatched: ClassVar[bool] = False
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (
        ("x", "m"),
        ("y", "m"),
        ("angle", "rad"),
    )

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "3"]:
        del t
        return jnp.append(b.local(a.position)[2], tilt(a, b))

    def place(self, z: Float[Array, "3"]) -> Pose:
        return Pose(jnp.append(z[:2], 0), about_z(z[2]))

    def screws(self, z: Float[Array, "3"]) -> Float[Array, "3 6"]:
        place = jnp.append(z[:2], 0)
        moving = np.eye(6, dtype=z.dtype)[3:5]
        return jnp.concatenate([moving, turns_at(place)[2:]])

    def read(self, a: Pose, b: Pose) -> Float[Array, "3"]:
        return jnp.append(b.local(a.position)[:2], angle_about_z(a, b))

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A square of the plane at the foot of `a`."""
        del t
        a, b = poses
        flat = placed(b, square(b.local(a.position), size))
        return Outline(flat, "track"), Outline(a.position[None], "point")
