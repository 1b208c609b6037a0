"""A torque on a body."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector
from ...common.errors import SceneError
from ..drawing import arrow, normals, placed, turning_arrow
from ..fields import UNIT, Converted, check_choice, number
from ..marker import Marker, Pose, Poses, Twists, Wrench, Wrenches
from ..outline import Outline, Outlines
from ..signal import AbstractSignal, signal_field
from .base import AbstractMarkerEffect, check_direction, check_markers, directed


class Torque(AbstractMarkerEffect):
    """A torque of changing strength: about the normal of the plane, in space about a direction.

    **Arguments:**

    - `at`: the marker it acts on.
    - `signal`: the strength over time [N m], positive counter-clockwise, by the right hand.
    - `direction`: in space any non-zero vector, of which only the direction counts; the z axis of
      the marker unless given. It may stand before the signal, as that of a `Force` does.
    - `frame`: what the direction is fixed to: "world", or "body", the marker itself.
    """

    at: Marker
    signal: AbstractSignal = signal_field(metadata={UNIT: "N m"})
    direction: Converted[Float[Array, "3"] | None, Vector | None] = number(default=None)
    frame: str = eqx.field(static=True, default="world")
    needs_twists: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def __post_init__(self) -> None:
        if isinstance(self.direction, AbstractSignal):
            self.signal, self.direction = self.direction, self.signal

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del twists
        (pose,) = poses
        return (Wrench(jnp.zeros_like(pose.position), self._torque(pose, self.signal(t))),)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow around the marker, in the sense of the torque; in space one along it too."""
        (pose,) = poses
        sense = jnp.where(self.signal(t) < 0, -1.0, 1.0)
        way = turning_arrow(size, sense)
        if pose.dimension == 2:
            return Outline(placed(pose, way), "load"), Outline(pose.position[None], "point")
        ahead = self._torque(pose, jnp.ones_like(size))
        axis = arrow(pose.position, pose.position + 3 * size * sense * ahead, size)
        return Outline(pose.position[None] + way @ normals(ahead), "load"), Outline(axis, "load")

    def check(self) -> None:
        owner = check_markers(self)
        self.signal.check(owner)
        if self.direction is None:
            check_choice(owner, "frame", self.frame, ("world", "body"))
        elif self.at.dimension == 2:
            raise SceneError(
                f"{owner}: direction is {self.direction}, but a torque in the plane is about its "
                "normal; leave it out.",
                field="direction",
            )
        else:
            check_direction(owner, self, 3)

    def _torque(self, pose: Pose, strength: Float[Array, ""]) -> Float[Array, "*d"]:
        """The torque of a strength, by inertial axes."""
        if self.direction is None:
            return pose.torque(strength)
        torque = strength * self.direction / jnp.linalg.norm(self.direction)
        return directed(torque, self.frame, pose)
