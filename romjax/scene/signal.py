"""Signals: numbers that change with time. Their parameters are traced, their kind is static."""

import abc
import functools
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Number, Time, Vector, as_array, concrete
from ..common.errors import SceneError
from .fields import Converted, check_finite, check_positive, check_shape, number, radians

__all__ = [
    "AbstractSignal",
    "Chirp",
    "Constant",
    "Held",
    "Ramp",
    "Sine",
    "Step",
    "Sum",
    "Table",
    "signal_field",
]

# Cycles of a vibration that a step may contain: of more, errors are not seen, and those of steps
# that are all alike add up.
_CYCLES = 0.25
# Where a table bends less than this share of its sharpest bend, it is straight but for rounding.
_STRAIGHT = 1e-9


class AbstractSignal(eqx.Module):
    """A function of time [s]; subclass it with one `__call__` for a signal of your own.

    What is shorter than a step, the step does not see. A signal therefore says where steps have to
    end, by `corners`, or how long they may be, by `longest_step`. A run with a signal that says
    neither looks at it sixteen times between two outputs, at all of which its steps end. What is
    hidden between the looks, it does not see.
    """

    # Whether it has two continuous derivatives, as a motion has that finite forces can follow.
    smooth: ClassVar[bool] = True
    # Whether it has the same value at all times, whatever its numbers are.
    is_constant: ClassVar[bool] = False

    def corners(self) -> Float[Array, " k"]:
        """Times [s] at which the signal or one of its derivatives jumps, in any order; infinite
        ones are none.
        """
        return jnp.zeros(0)

    def longest_step(self, t: Time) -> Float[Array, ""]:
        """The longest step from a time t that still sees how the signal changes [s]."""
        return jnp.full_like(t, jnp.inf)

    @property
    def is_known(self) -> bool:
        """Whether the signal says where its steps have to end, or how long they may be."""
        own, base = type(self), AbstractSignal
        return own.corners is not base.corners or own.longest_step is not base.longest_step

    @abc.abstractmethod
    def __call__(self, t: Time) -> Float[Array, ""]:
        """The value at time t [s]."""

    @property
    def takes_start(self) -> bool:
        """Whether it has an offset that was left out, which a prescribed motion takes from where
        the bodies are placed.
        """
        return False

    def starting_at(self, value: Number) -> "AbstractSignal":
        """The signal with the offset that was left out, such that it has a `value` at t = 0; as it
        is where none was.
        """
        del value
        return self

    def check(self, owner: str) -> None:
        """Raise SceneError for numbers that are not finite, its own and those of signals in it."""
        for name, value in vars(self).items():
            for part in jtu.tree_leaves(value, is_leaf=is_signal):
                if isinstance(part, AbstractSignal):
                    part.check(owner)
                elif eqx.is_array_like(part):
                    check_finite(owner, f"{type(self).__name__}.{name}", as_array(part))


def is_signal(x: Any) -> bool:
    """Whether it is a signal, where leaves of a pytree are asked for."""
    return isinstance(x, AbstractSignal)


def signals_of(tree: Any) -> list[AbstractSignal]:
    """The signals in a pytree, without those that others hold."""
    return [x for x in jtu.tree_leaves(tree, is_leaf=is_signal) if is_signal(x)]


if TYPE_CHECKING:  # why, see fields.py
    from equinox import field as signal_field
else:

    def signal_field(**kwargs: Any) -> Any:
        """A field that holds a signal."""
        return eqx.field(converter=_as_signal, **kwargs)


def _as_signal(value: Any) -> AbstractSignal:
    if not isinstance(value, AbstractSignal):
        raise SceneError(
            f"signal is {value!r}; give a signal such as Constant(10.0) "
            "or Sine(10.0, frequency=2.0)."
        )
    return value


class Constant(AbstractSignal):
    """The same `value` at all times."""

    is_constant: ClassVar[bool] = True

    value: Converted[Float[Array, ""]] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        del t
        return self.value

    def corners(self) -> Float[Array, " k"]:
        return jnp.zeros(0)


class Held(AbstractSignal):
    """The value that a `Sampled` controller has set last to its signal of the name `output`.

    `value`: that of now, which runs keep.
    """

    output: str = eqx.field(static=True)
    value: Converted[Float[Array, ""]] = number(default=0.0)

    def __call__(self, t: Time) -> Float[Array, ""]:
        del t
        return self.value

    def corners(self) -> Float[Array, " k"]:
        return jnp.zeros(0)

    def check(self, owner: str) -> None:
        check_finite(owner, "Held.value", self.value)


class Sine(AbstractSignal):
    """`amplitude * sin(2 pi frequency t + phase)`; frequency [Hz], phase [rad]."""

    amplitude: Converted[Float[Array, ""]] = number()
    frequency: Converted[Float[Array, ""]] = number()
    phase: Converted[Float[Array, ""]] = radians(default=0.0)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * t + self.phase)

    def longest_step(self, t: Time) -> Float[Array, ""]:
        return jnp.full_like(t, _CYCLES) / jnp.abs(self.frequency)


class Ramp(AbstractSignal):
    """`rate * t + offset`; the rate per second.

    The `offset` of a prescribed angle or travel that is left out is the one at which the bodies are
    placed at the start, so that a drive begins where its crank stands; elsewhere it is zero. It is
    found when the scene is assembled, and follows a start that changes. Scene files take degrees as
    `offset_deg`.
    """

    rate: Converted[Float[Array, ""]] = number()
    offset: Converted[Float[Array, ""] | None, Number | None] = radians(default=None)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.rate * t if self.offset is None else self.rate * t + self.offset

    @property
    def takes_start(self) -> bool:
        return self.offset is None

    def starting_at(self, value: Number) -> "Ramp":
        return Ramp(self.rate, value) if self.takes_start else self

    def corners(self) -> Float[Array, " k"]:
        return jnp.zeros(0)


class Table(AbstractSignal):
    """`values` at given `times` [s], joined by straight lines, constant beyond both ends."""

    smooth: ClassVar[bool] = False

    times: Converted[Float[Array, " k"], Vector] = number()
    values: Converted[Float[Array, " k"], Vector] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        return jnp.interp(t, self.times, self.values)

    def corners(self) -> Float[Array, " k"]:
        slopes = jnp.diff(self.values) / jnp.diff(self.times)
        bends = jnp.abs(jnp.diff(jnp.pad(slopes, 1)))
        # Where a table is straight, or constant, steps may pass its points.
        return jnp.where(bends > _STRAIGHT * jnp.max(bends), self.times, jnp.inf)

    def check(self, owner: str) -> None:
        check_shape(owner, "Table.times", self.times, (None,))
        check_shape(owner, "Table.values", self.values, jnp.shape(self.times))
        super().check(owner)
        times = concrete(self.times)
        if times is not None and not np.all(np.diff(times) > 0):
            raise SceneError(f"{owner}: Table.times must increase, but they are {times}.")


class Chirp(AbstractSignal):
    """`amplitude * sin(...)` whose frequency grows by `rate` [Hz/s] from `frequency` [Hz]."""

    amplitude: Converted[Float[Array, ""]] = number()
    frequency: Converted[Float[Array, ""]] = number()
    rate: Converted[Float[Array, ""]] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.amplitude * jnp.sin(2 * jnp.pi * (self.frequency + self.rate * t / 2) * t)

    def longest_step(self, t: Time) -> Float[Array, ""]:
        # Within h, the phase advances by at most |f| h + |r| h² / 2 cycles, the frequency f at t:
        # by c and c / 2 for h = c / (|f| + √(|r| c)).
        frequency = jnp.abs(self.frequency + self.rate * t)
        return _CYCLES / (frequency + jnp.sqrt(_CYCLES * jnp.abs(self.rate)))


class Step(AbstractSignal):
    """A smooth step: zero before the time `start` [s], `height` after `start + duration`."""

    height: Converted[Float[Array, ""]] = number()
    start: Converted[Float[Array, ""]] = number()
    duration: Converted[Float[Array, ""]] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        x = jnp.clip((t - self.start) / self.duration, 0.0, 1.0)
        return self.height * x**3 * (10 - 15 * x + 6 * x**2)

    def corners(self) -> Float[Array, " k"]:
        return jnp.stack([self.start, self.start + self.duration])

    def check(self, owner: str) -> None:
        super().check(owner)
        check_positive(owner, "Step.duration", self.duration, "A jump is a short duration.")


class Sum(AbstractSignal):
    """The sum of several signals, its `terms`.

    Of ramps whose offsets are left out the first takes all that the sum takes from the start.
    """

    terms: tuple[AbstractSignal, ...]

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        return all(term.smooth for term in self.terms)

    @property
    def is_constant(self) -> bool:  # type: ignore[override]
        return all(term.is_constant for term in self.terms)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return jnp.sum(jnp.stack([term(t) for term in self.terms]))

    def corners(self) -> Float[Array, " k"]:
        return jnp.concatenate([jnp.zeros(0), *(term.corners() for term in self.terms)])

    def longest_step(self, t: Time) -> Float[Array, ""]:
        each = [term.longest_step(t) for term in self.terms]
        return functools.reduce(jnp.minimum, each, jnp.full_like(t, jnp.inf))

    @property
    def is_known(self) -> bool:
        return all(term.is_known for term in self.terms)

    @property
    def takes_start(self) -> bool:
        return any(term.takes_start for term in self.terms)

    def starting_at(self, value: Number) -> "Sum":
        for i, term in enumerate(self.terms):
            if term.takes_start:
                others = [other(0.0) for other in (*self.terms[:i], *self.terms[i + 1 :])]
                begun = term.starting_at(value - sum(others))
                return Sum((*self.terms[:i], begun, *self.terms[i + 1 :]))
        return self
