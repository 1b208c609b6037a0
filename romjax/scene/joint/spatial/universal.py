"""A universal joint."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....arrays import Time
from ...marker import Marker, Pose
from ..base import AbstractJoint
from .directions import axis


class Universal(AbstractJoint):
    """The two markers stay at one position, and their z axes at a right angle: the two axes of a
    Cardan's cross.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        return jnp.append(a.position - b.position, jnp.sum(axis(a, 2) * axis(b, 2)))
