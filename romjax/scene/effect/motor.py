"""A motor that follows an angle."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..counted_angle import counted_angle
from ..drawing import placed, turning_arrow
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Poses, Twists, Wrench, Wrenches
from ..outline import Outline, Outlines
from ..signal import AbstractSignal, signal_field
from .base import AbstractMarkerEffect, check_markers


class Motor(AbstractMarkerEffect):
    """A motor with proportional and derivative control of the angle θ = φ_a − φ_b.

    Marker `a` feels the torque P (target − θ) + D (target' − θ'), marker `b` its reaction. Angles
    count full turns. In space all are about the z axis of `b`, and θ is between −π and π at the
    start; markers that are made by an `axis` may have different x axes there, by which θ begins.

    **Arguments:**

    - `a`, `b`: what it turns, and what carries it.
    - `target`: the wanted angle over time [rad].
    - `proportional`: P [N m/rad]. `derivative`: D [N m s/rad].
    """

    a: Marker
    b: Marker
    target: AbstractSignal = signal_field()
    proportional: Converted[Float[Array, ""]] = number()
    derivative: Converted[Float[Array, ""]] = number()
    needs_twists: ClassVar[bool] = True
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        a, b, *counter = poses
        angle = counted_angle(a, b, *counter)
        speed = b.about(twists[0].angular_velocity - twists[1].angular_velocity)
        t = jnp.asarray(t, angle.dtype)
        target, rate = jax.jvp(self.target, (t,), (jnp.ones_like(t),))
        strength = self.proportional * (target - angle) + self.derivative * (rate - speed)
        torque, none = b.torque(strength), jnp.zeros_like(a.position)
        idle = [Wrench(none, jnp.zeros_like(torque)) for _ in counter]
        return Wrench(none, torque), Wrench(none, -torque), *idle

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow around `a`, in the sense in which the target turns."""
        a, _ = poses
        t = jnp.asarray(t, size.dtype)
        way = placed(a, turning_arrow(size, jax.grad(self.target)(t)))
        return Outline(way, "load"), Outline(a.position[None], "point")

    def check(self) -> None:
        owner = check_markers(self)
        self.target.check(owner)
        check_numbers(owner, self, "proportional", "derivative", sign="not negative")
