"""Signals: numbers that change with time. Their parameters are traced, their kind is static."""

import abc
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Time, Vector, as_array, concrete
from ..errors import SceneError
from .fields import Converted, check_finite, check_positive, check_shape, number, radians

__all__ = [
    "AbstractSignal",
    "Chirp",
    "Constant",
    "Ramp",
    "Sine",
    "Step",
    "Sum",
    "Table",
    "signal_field",
]


class AbstractSignal(eqx.Module):
    """A function of time [s]; subclass it with one `__call__` for a signal of your own."""

    # Whether it has two continuous derivatives, as a motion has that finite forces can follow.
    smooth: ClassVar[bool] = True

    @abc.abstractmethod
    def __call__(self, t: Time) -> Float[Array, ""]:
        """The value at time t [s]."""

    def check(self, owner: str) -> None:
        for name, value in vars(self).items():
            check_finite(owner, f"{type(self).__name__}.{name}", as_array(value))


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

    value: Converted[Float[Array, ""]] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        del t
        return self.value


class Sine(AbstractSignal):
    """`amplitude * sin(2 pi frequency t + phase)`; frequency [Hz], phase [rad]."""

    amplitude: Converted[Float[Array, ""]] = number()
    frequency: Converted[Float[Array, ""]] = number()
    phase: Converted[Float[Array, ""]] = radians(default=0.0)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * t + self.phase)


class Ramp(AbstractSignal):
    """`rate * t + offset`; the rate per second."""

    rate: Converted[Float[Array, ""]] = number()
    offset: Converted[Float[Array, ""]] = number(default=0.0)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.rate * t + self.offset


class Table(AbstractSignal):
    """`values` at given `times` [s], joined by straight lines, constant beyond both ends."""

    smooth: ClassVar[bool] = False

    times: Converted[Float[Array, " k"], Vector] = number()
    values: Converted[Float[Array, " k"], Vector] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        return jnp.interp(t, self.times, self.values)

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


class Step(AbstractSignal):
    """Zero before the time `start` [s], `height` after `start + duration`, smooth in between."""

    height: Converted[Float[Array, ""]] = number()
    start: Converted[Float[Array, ""]] = number()
    duration: Converted[Float[Array, ""]] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        x = jnp.clip((t - self.start) / self.duration, 0.0, 1.0)
        return self.height * x**3 * (10 - 15 * x + 6 * x**2)

    def check(self, owner: str) -> None:
        super().check(owner)
        check_positive(owner, "Step.duration", self.duration, "A jump is a short duration.")


class Sum(AbstractSignal):
    """The sum of several signals, its `terms`."""

    terms: tuple[AbstractSignal, ...]

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        return all(term.smooth for term in self.terms)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return jnp.sum(jnp.stack([term(t) for term in self.terms]))

    def check(self, owner: str) -> None:
        for term in self.terms:
            term.check(owner)
