"""Signals whose time runs faster."""

from jaxtyping import Array, Float

from ..common.arrays import Number, Time, as_array
from ..scene.signal import (
    AbstractSignal,
    Chirp,
    Constant,
    Held,
    Ramp,
    Sine,
    Step,
    Sum,
    Table,
)

# Kinds that have the time of a faster one in their numbers: the structure of a mechanism stays, and
# nothing is compiled for it.
_KINDS = (Ramp, Sine, Chirp, Table, Step, Sum, Constant, Held)


def at_speed(signal: AbstractSignal, speed: float) -> AbstractSignal:
    """The signal with its time running faster by a factor."""
    if type(signal) not in _KINDS:
        return Paced(signal, as_array(speed))
    match signal:
        case Ramp():
            return Ramp(signal.rate * speed, signal.offset)
        case Sine():
            return Sine(signal.amplitude, signal.frequency * speed, signal.phase)
        case Chirp():
            return Chirp(signal.amplitude, signal.frequency * speed, signal.rate * speed**2)
        case Table():
            return Table(signal.times / speed, signal.values)
        case Step():
            return Step(signal.height, signal.start / speed, signal.duration / speed)
        case Sum():
            return Sum(tuple(at_speed(term, speed) for term in signal.terms))
    return signal


class Paced(AbstractSignal):
    """A signal of a user's own, with its time running faster by the factor `speed`."""

    signal: AbstractSignal
    speed: Float[Array, ""]

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        return self.signal.smooth

    @property
    def is_known(self) -> bool:
        return self.signal.is_known

    @property
    def is_constant(self) -> bool:  # type: ignore[override]
        return self.signal.is_constant

    @property
    def takes_start(self) -> bool:
        return self.signal.takes_start

    def starting_at(self, value: Number) -> "Paced":
        return Paced(self.signal.starting_at(value), self.speed)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.signal(self.speed * t)

    def corners(self) -> Float[Array, " k"]:
        return self.signal.corners() / self.speed

    def longest_step(self, t: Time) -> Float[Array, ""]:
        return self.signal.longest_step(self.speed * t) / self.speed
