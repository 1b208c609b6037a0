"""A torque on a body."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import placed, turning_arrow
from ..fields import UNIT
from ..marker import Marker, Poses, Twists, Wrench, Wrenches
from ..outline import Outline, Outlines
from ..signal import AbstractSignal, signal_field
from .base import AbstractMarkerEffect, check_markers


class Torque(AbstractMarkerEffect):
    """A torque of changing strength; in the plane it is the same in every frame.

    **Arguments:**

    - `at`: the marker it acts on.
    - `signal`: the strength over time [N m], positive counter-clockwise.
    """

    at: Marker
    signal: AbstractSignal = signal_field(metadata={UNIT: "N m"})
    needs_twists: ClassVar[bool] = False

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del twists
        return (Wrench(jnp.zeros_like(poses[0].position), self.signal(t)),)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow around the marker, in the sense of the torque."""
        (pose,) = poses
        way = placed(pose, turning_arrow(size, self.signal(t)))
        return Outline(way, "load"), Outline(pose.position[None], "point")

    def check(self) -> None:
        self.signal.check(check_markers(self))
