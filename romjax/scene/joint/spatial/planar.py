"""A joint that slides on a plane."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....arrays import Time
from ...marker import Marker, Pose
from ..base import AbstractJoint
from .directions import tilt


class Planar(AbstractJoint):
    """Marker `a` stays in the plane z = 0 of marker `b`, and turns about its normal."""

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 3
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "3"]:
        del t
        return jnp.append(b.local(a.position)[2], tilt(a, b))
