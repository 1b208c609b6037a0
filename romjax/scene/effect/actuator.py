"""An actuator that drives a joint by a signal."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time, concatenate
from ..fields import Converted, check_kind, check_numbers, number
from ..limits import check_limits, cut_off
from ..marker import Marker, Poses, Twists, Wrenches
from ..motion import check_motion
from ..signal import AbstractSignal, signal_field
from .activation import Activation
from .along_motion import AbstractMotionEffect
from .base import check_markers
from .state_effect import AbstractStateEffect


class Actuator(AbstractMotionEffect, AbstractStateEffect):
    """A motor behind a gear: with the motion s of the joint and the gear ratio n, its own force is

        f = gain u(t) + offset − P n s − D n s',

    cut off at `least` and `largest`, and the joint feels n f. A servo for the position has
    gain = P, one for the speed gain = D, and a plain motor the gain alone. An `activation` a that
    filters or integrates u takes its place, as in a drive that lags.

    **Arguments:**

    - `a`, `b`: what it moves, and what carries it.
    - `signal`: u over time, cut off at `least_signal` and `largest_signal` if they are given.
    - `gear`: n. `gain`, `offset` [N m], [N].
    - `proportional`: P [N m/rad], [N/m]. `derivative`: D [N m s/rad], [N s/m].
    - `least`, `largest`: of f; none unless given.
    - `motion`: what s is, as in `JointSpring`.
    - `name`: of the actuator, by which results list it.
    - `activation`: an `Activation`, whose state is `run["name.activation"]`; none unless given.
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
    activation: Activation | None = None
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        return () if self.activation is None else ("activation",)

    def initial(self) -> Float[Array, " k"]:
        return concatenate([] if self.activation is None else [self.activation.start])

    def rates(
        self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists
    ) -> Float[Array, " k"]:
        del poses, twists
        assert self.activation is not None  # else there is no state
        return self.activation.rate(self._signal(t), states[0])[None]

    def driven(self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists) -> Wrenches:
        value, rate, wrenches = self.displacement(poses, twists)
        a = self.activation
        signal = self._signal(t) if a is None else a.value(states[0])
        return wrenches(self._pushes(signal, value, rate))

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        return self._pushes(self._signal(t), value, rate)

    def _signal(self, t: Time) -> Float[Array, ""]:
        return cut_off(self.signal(t), self.least_signal, self.largest_signal)

    def _pushes(
        self, signal: Float[Array, ""], value: Float[Array, ""], rate: Callable[[], Array]
    ) -> Float[Array, ""]:
        """The force that the joint feels, by what drives it."""
        feedback = self.proportional * value + self.derivative * rate()
        force = self.gain * signal + self.offset - self.gear * feedback
        return self.gear * cut_off(force, self.least, self.largest)

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        self.signal.check(owner)
        check_numbers(owner, self, "gear", "gain", "offset", "proportional", "derivative")
        check_limits(owner, self)
        check_limits(owner, self, "least_signal", "largest_signal")
        if self.activation is not None:
            remedy = "one, such as romjax.Activation(time_constant=0.1)"
            check_kind(owner, "activation", self.activation, Activation, remedy)
            self.activation.check(owner)
