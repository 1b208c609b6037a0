"""The free joint of a body that no joint holds: its coordinates are those of its frame."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...scene.coordinate import frame_coordinates
from ...scene.joint.base import turns_at
from ...scene.marker import Pose


class Free(eqx.Module):
    """A joint without constraints, between a body and the ground.

    - `size`: how many coordinates a frame has, 3 in the plane, 7 in space.
    """

    size: int = eqx.field(static=True)
    motions: ClassVar[tuple[str, ...]] = ()

    @property
    def freedoms(self) -> tuple[tuple[str, str], ...]:
        """The names and units of the coordinates of a frame."""
        frame = frame_coordinates("", 2 if self.size == 3 else 3)
        return tuple((each.label.lstrip("."), each.unit) for each in frame)

    @property
    def turns_freely(self) -> bool:
        """Whether the last four coordinates are a quaternion."""
        return self.size == 7

    def place(self, z: Float[Array, " size"]) -> Pose:
        """The pose of the frame."""
        return Pose(z[:2], z[2]) if self.size == 3 else Pose(z[:3], z[3:])

    def screws(self, z: Float[Array, " size"]) -> Float[Array, "rates twist"]:
        """The twists of the frame for unit rates, about the origin."""
        if self.size == 3:
            # A unit turn about (x, y) moves the point of the body at the origin by (y, −x).
            moving = np.eye(3, dtype=z.dtype)[1:]
            return jnp.concatenate([moving, jnp.stack([jnp.ones_like(z[0]), z[1], -z[0]])[None]])
        return jnp.concatenate([np.eye(6, dtype=z.dtype)[3:], turns_at(z[:3])])

    def read(self, a: Pose, b: Pose) -> Float[Array, " size"]:
        """Return the coordinates of the frame."""
        del b
        return jnp.append(a.position, a.turn)
