"""A force on a point."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector
from ..drawing import arrow
from ..fields import UNIT, Converted, number
from ..marker import Marker, Poses, Twists, Wrench, Wrenches
from ..outline import Outline, Outlines
from ..signal import AbstractSignal, signal_field
from .base import AbstractMarkerEffect, check_direction, check_markers, directed


class Force(AbstractMarkerEffect):
    """A force of changing strength in a fixed direction.

    **Arguments:**

    - `at`: the marker it acts on.
    - `direction`: any non-zero vector; only its direction counts.
    - `signal`: the strength over time [N].
    - `frame`: what the direction is fixed to: "world", or "body", the marker itself.
    """

    at: Marker
    direction: Converted[Float[Array, " d"], Vector] = number()
    signal: AbstractSignal = signal_field(metadata={UNIT: "N"})
    frame: str = eqx.field(static=True, default="world")
    needs_twists: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return (0,) if self.frame == "world" else ()

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del twists
        force = self.signal(t) * self.direction / jnp.linalg.norm(self.direction)
        force = directed(force, self.frame, poses[0])
        return (Wrench(force, jnp.zeros_like(force[0] if force.shape == (2,) else force)),)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow of fixed length from the marker, in the direction of the force."""
        (wrench,) = self.wrenches(t, poses, ())
        (pose,) = poses
        strength = jnp.sqrt(wrench.force @ wrench.force)
        given = self.direction / jnp.sqrt(self.direction @ self.direction)
        ahead = directed(given, self.frame, pose)
        strong = strength > 0
        ahead = jnp.where(strong, wrench.force / jnp.where(strong, strength, 1.0), ahead)
        return (Outline(arrow(pose.position, pose.position + 4 * size * ahead, size), "load"),)

    def check(self) -> None:
        owner = check_markers(self)
        check_direction(owner, self, self.at.dimension)
        self.signal.check(owner)
