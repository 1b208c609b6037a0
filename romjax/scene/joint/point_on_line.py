"""A point that slides along a line."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import rail
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import QUATERNION, AbstractJoint, turns_at


class PointOnLine(AbstractJoint):
    """Marker `a` stays on the local x axis of marker `b` (chapter equation 39.14), in space on its
    z axis; it may turn.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    at_points: ClassVar[tuple[int, ...]] = (0,)
    hatched: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def rows(self) -> int:  # type: ignore[override]
        return self.b.dimension - 1

    @property
    def freedoms(self) -> tuple[tuple[str, str], ...]:  # type: ignore[override]
        return (("travel", "m"), *((("angle", "rad"),) if self.b.dimension == 2 else QUATERNION))

    @property
    def turns_freely(self) -> bool:  # type: ignore[override]
        return self.b.dimension == 3

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        del t
        return jnp.atleast_1d(b.across(a.position))

    def place(self, z: Float[Array, " freedoms"]) -> Pose:
        if self.b.dimension == 2:
            return Pose(jnp.append(z[:1], 0), z[1])
        return Pose(jnp.pad(z[:1], (2, 0)), z[1:])

    def screws(self, z: Float[Array, " freedoms"]) -> Float[Array, "rates twist"]:
        if self.b.dimension == 2:
            # A turn about (z, 0) moves the point of `a` at the origin of `b` by −z along y.
            turning = jnp.stack([jnp.ones_like(z[0]), jnp.zeros_like(z[0]), -z[0]])
            return jnp.stack([np.eye(3, dtype=z.dtype)[1], turning])
        place = jnp.pad(z[:1], (2, 0))
        return jnp.concatenate([np.eye(6, dtype=z.dtype)[5:], turns_at(place)])

    def read(self, a: Pose, b: Pose) -> Float[Array, " freedoms"]:
        relative = a.against(b)
        return jnp.append(b.along(a.position), relative.turn)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        return (
            Outline(rail(b, a.position, size), "track", endless=True),
            Outline(a.position[None], "hinge"),
        )
