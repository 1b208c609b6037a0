"""An actuator that lags behind its command."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time, concatenate
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Poses, Twists, Wrenches
from ..motion import check_motion
from ..signal import AbstractSignal, signal_field
from .along_motion import AbstractMotionEffect
from .base import check_markers
from .state_effect import AbstractStateEffect


class LowPass(AbstractMotionEffect, AbstractStateEffect):
    """A force along the motion s of a joint that follows its command with a lag of first order,

        τ f' = gain u(t) − P s − D s' − f.

    A motor of the inductance L and the resistance R, with the torque k i at the current i and as
    much of a back electromotive force, has τ = L/R, gain = k/R for a voltage u, D = k²/R, and
    f = k i (L i' = u − R i − k s').

    **Arguments:**

    - `a`, `b`: what it moves, and what carries it.
    - `signal`: u over time. `gain` [N m], [N]: of u.
    - `time_constant`: τ [s].
    - `proportional`: P [N m/rad], [N/m]. `derivative`: D [N m s/rad], [N s/m].
    - `start`: f at the start [N m], [N].
    - `motion`: what s is, as in `JointSpring`.
    - `name`: of the actuator; "force" is its state, `run["name.force"]`.

    Raises SceneError for a time constant that is not positive.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field()
    time_constant: Converted[Float[Array, ""]] = number()
    gain: Converted[Float[Array, ""]] = number(default=1.0)
    proportional: Converted[Float[Array, ""]] = number(default=0.0)
    derivative: Converted[Float[Array, ""]] = number(default=0.0)
    start: Converted[Float[Array, ""]] = number(default=0.0)
    motion: str = eqx.field(static=True, default="angle")
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    states: ClassVar[tuple[str, ...]] = ("force",)

    def initial(self) -> Float[Array, " k"]:
        return concatenate([self.start])

    def rates(
        self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists
    ) -> Float[Array, " k"]:
        value, rate, _ = self.displacement(poses, twists)
        feedback = self.proportional * value + self.derivative * rate()
        # τ f' = command − f.
        command = self.gain * self.signal(t) - feedback
        return (command - states) / self.time_constant

    def driven(self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists) -> Wrenches:
        del t
        _, _, wrenches = self.displacement(poses, twists)
        return wrenches(states[0])

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        self.signal.check(owner)
        check_numbers(owner, self, "time_constant", sign="positive")
        check_numbers(owner, self, "gain", "proportional", "derivative", "start")
