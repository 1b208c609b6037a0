"""An actuator that drives a joint by a signal."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..limits import cut_off
from ..marker import Marker, Poses, Twists, Wrenches
from ..motion import check_motion
from ..signal import AbstractSignal, signal_field
from .along_motion import AbstractMotionEffect
from .base import check_markers


class Actuator(AbstractMotionEffect):
    """A motor behind a gear: with the motion s of the joint and the gear ratio n, its own force is

        f = gain u(t) + offset − P n s − D n s',

    cut off at `least` and `largest`, and the joint feels n f. A servo for the position has
    gain = P, one for the speed gain = D, and a plain motor the gain alone.

    **Arguments:**

    - `a`, `b`: what it moves, and what carries it.
    - `signal`: u over time, cut off at `least_signal` and `largest_signal` if they are given.
    - `gear`: n. `gain`, `offset` [N m], [N].
    - `proportional`: P [N m/rad], [N/m]. `derivative`: D [N m s/rad], [N s/m].
    - `least`, `largest`: of f; none unless given.
    - `motion`: what s is, as in `JointSpring`.
    - `name`: of the actuator, by which results list it.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field()
    gear: Converted[Float[Array, ""]] = number(default=1.0)
    gain: Converted[Float[Array, ""]] = number(default=1.0)
    offset: Converted[Float[Array, ""]] = number(default=0.0)
    proportional: Converted[Float[Array, ""]] = number(default=0.0)
    derivative: Converted[Float[Array, ""]] = number(default=0.0)
    least: Converted[Float[Array, ""] | None] = number(default=None)
    largest: Converted[Float[Array, ""] | None] = number(default=None)
    least_signal: Converted[Float[Array, ""] | None] = number(default=None)
    largest_signal: Converted[Float[Array, ""] | None] = number(default=None)
    motion: str = eqx.field(static=True, default="angle")
    name: str = eqx.field(static=True, default="")
    needs_twists: ClassVar[bool] = True

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        value, rate, wrenches = self.displacement(poses, twists)
        return wrenches(self.along(t, value, rate))

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        signal = cut_off(self.signal(t), self.least_signal, self.largest_signal)
        feedback = self.proportional * value + self.derivative * rate()
        force = self.gain * signal + self.offset - self.gear * feedback
        return self.gear * cut_off(force, self.least, self.largest)

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        self.signal.check(owner)
        check_numbers(owner, self, "gear", "gain", "offset", "proportional", "derivative")
        check_numbers(owner, self, "least", "largest", "least_signal", "largest_signal")
