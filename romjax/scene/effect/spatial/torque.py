"""A torque on a body in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time, Vector
from ...drawing import arrow, normals, turning_arrow
from ...fields import UNIT, Converted, number
from ...marker import Marker, Poses, Twists, Wrench, Wrenches
from ...outline import Outline, Outlines
from ...signal import AbstractSignal, signal_field
from ..base import AbstractMarkerEffect, check_direction, check_markers, directed


class Torque(AbstractMarkerEffect):
    """A torque of changing strength about a fixed direction.

    **Arguments:**

    - `at`: the marker it acts on.
    - `direction`: any non-zero vector; only its direction counts.
    - `signal`: the strength over time [N m], positive by the right hand.
    - `frame`: what the direction is fixed to: "world", or "body", the marker itself.
    """

    at: Marker
    direction: Converted[Float[Array, "3"], Vector] = number()
    signal: AbstractSignal = signal_field(metadata={UNIT: "N m"})
    frame: str = eqx.field(static=True, default="world")
    needs_twists: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del twists
        torque = self.signal(t) * self.direction / jnp.linalg.norm(self.direction)
        torque = directed(torque, self.frame, poses[0])
        return (Wrench(jnp.zeros_like(torque), torque),)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow along the direction of the torque, and one around it in its sense."""
        (pose,) = poses
        given = self.direction / jnp.sqrt(self.direction @ self.direction)
        ahead = directed(given, self.frame, pose)
        strength = jnp.where(self.signal(t) < 0, -1.0, 1.0)
        way = turning_arrow(size, strength) @ normals(ahead)
        axis = arrow(pose.position, pose.position + 3 * size * strength * ahead, size)
        return Outline(pose.position[None] + way, "load"), Outline(axis, "load")

    def check(self) -> None:
        owner = check_markers(self)
        check_direction(owner, self, 3)
        self.signal.check(owner)
