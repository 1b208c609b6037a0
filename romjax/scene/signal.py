"""Signals: numbers that change with time. Their parameters are traced, their kind is static."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .fields import SceneError, Time, as_array, check_finite, check_shape, concrete, number


class AbstractSignal(eqx.Module):
    """A function of time [s]; subclass it with one `__call__` for a signal of your own."""

    @abc.abstractmethod
    def __call__(self, t: Time) -> Float[Array, ""]:
        """The value at time t [s]."""

    def check(self, owner: str) -> None:
        for name, value in vars(self).items():
            check_finite(owner, f"{type(self).__name__}.{name}", as_array(value))


class Constant(AbstractSignal):
    """The same `value` at all times."""

    value: Float[Array, ""] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        del t
        return self.value


class Sine(AbstractSignal):
    """`amplitude * sin(2 pi frequency t + phase)`; frequency [Hz], phase [rad]."""

    amplitude: Float[Array, ""] = number()
    frequency: Float[Array, ""] = number()
    phase: Float[Array, ""] = number(0.0)

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * t + self.phase)


class Table(AbstractSignal):
    """Values at given times [s], joined by straight lines, constant beyond both ends."""

    times: Float[Array, " k"] = number()
    values: Float[Array, " k"] = number()

    def __call__(self, t: Time) -> Float[Array, ""]:
        return jnp.interp(t, self.times, self.values)

    def check(self, owner: str) -> None:
        check_shape(owner, "Table.times", self.times, (None,))
        check_shape(owner, "Table.values", self.values, jnp.shape(self.times))
        super().check(owner)
        times = concrete(self.times)
        if times is not None and not np.all(np.diff(times) > 0):
            raise SceneError(f"{owner}: Table.times must increase, but they are {times}.")
