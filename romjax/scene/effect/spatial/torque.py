"""A torque on a body in space."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....arrays import Time, Vector, concrete
from ....errors import SceneError
from ...drawing import arrow, normals, turning_arrow
from ...fields import Converted, check_numbers, number
from ...marker import Marker, Pose, Twist, Wrench
from ...outline import Outline
from ...signal import AbstractSignal, signal_field
from ..base import AbstractMarkerEffect, check_markers


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
    signal: AbstractSignal = signal_field()
    frame: str = eqx.field(static=True, default="world")
    needs_twists: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def wrenches(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> tuple[Wrench, ...]:
        del twists
        torque = self.signal(t) * self.direction / jnp.linalg.norm(self.direction)
        if self.frame == "body":
            torque = poses[0].turned(torque)
        return (Wrench(jnp.zeros_like(torque), torque),)

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """An arrow along the direction of the torque, and one around it in its sense."""
        (pose,) = poses
        given = self.direction / jnp.sqrt(self.direction @ self.direction)
        ahead = pose.turned(given) if self.frame == "body" else given
        strength = jnp.where(self.signal(t) < 0, -1.0, 1.0)
        way = turning_arrow(size, strength) @ normals(ahead)
        axis = arrow(pose.position, pose.position + 3 * size * strength * ahead, size)
        return Outline(pose.position[None] + way, "load"), Outline(axis, "load")

    def check(self) -> None:
        owner = check_markers(self)
        check_numbers(owner, self, "direction", shape=(3,))
        direction = concrete(self.direction)
        if direction is not None and not np.any(direction):
            raise SceneError(f"{owner}: direction is {direction}; give a vector that is not zero.")
        if self.frame not in ("world", "body"):
            raise SceneError(f"{owner}: frame is {self.frame!r}, but it must be 'world' or 'body'.")
        self.signal.check(owner)
