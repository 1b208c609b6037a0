"""Angles in space that count full turns, for the joints and effects that ask for them.

A quaternion is the same after two turns. So that torsion springs, gears, screws and motors know
how often they have turned, the system has a coordinate more for each: the angle of a counter, with
an inertia a trillionth of what turns, which a constraint holds at the angle of two markers. It is a
coordinate as all others are: any solver, event, projection and derivative takes it as it is, and
the balance of energy is exact. Nothing but the counting constraint acts on it, since the forces of
its part read only the number of turns (`counted_angle`), so that its small inertia is no noise.

The inertia of a joint itself, such as that of a rotor (`JointInertia`), is a counter that has it.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time, as_jax
from .coordinate import Coordinate
from .joint.base import AbstractJoint
from .marker import Marker, Pose
from .motion import moved
from .one_coordinate import AbstractOneCoordinate


class TurnCounter(AbstractOneCoordinate):
    """A body that counts full turns: its coordinate is an angle [rad], in place of a frame's x."""

    name: str = eqx.field(static=True)
    inertia: Float[Array, ""]
    dimension: ClassVar[int] = 3

    def weight(self) -> Float[Array, ""]:
        return self.inertia

    def start(self) -> tuple[Float[Array, "1"], Float[Array, "1"]]:
        # Zeros of JAX would be a program, for which assembling waits.
        none = as_jax(np.zeros(1, self.inertia.dtype))
        return none, none

    def coordinates(self) -> tuple[Coordinate, ...]:
        about = f"angle with full turns, {self.name}"
        return (Coordinate(self.name, "angle", "rad", r"\varphi", about),)


class CounterJoint(AbstractJoint):
    """A joint that holds a counter at the angle of two markers, `a` against `b`, or at another
    `motion` of them, see `JointSpring`.
    """

    a: Marker
    b: Marker
    counter: Marker
    name: str = eqx.field(static=True, default="")
    motion: str = eqx.field(static=True, default="angle")
    rows: ClassVar[int] = 1
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    @property
    def markers(self) -> tuple[Marker, ...]:
        return self.a, self.b, self.counter

    def residual(self, t: Time, a: Pose, b: Pose, *counter: Pose) -> Float[Array, "1"]:
        del t
        at = counter[0].position[0]
        if self.motion in ("angle", "bounded angle"):
            return a.angle_against(b, at)[None]
        return (moved(self.motion, a, b) - at)[None]
