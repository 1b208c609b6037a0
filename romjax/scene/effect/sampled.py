"""Controllers with a clock of their own."""

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector, as_array, as_jax, concatenate
from ...common.errors import SceneError
from ...common.partition import Partitioned
from ..coordinate import find
from ..fields import Converted, check_numbers, number
from ..marker import Marker
from .base import AbstractEffect

# The share of a period by which a step may miss a tick, of rounding.
_NEAR = 1e-7
# Or by so many units in the last place of the time.
_ROUNDING = 8


class Law(eqx.Module):
    """A function, or a module that is called, as a pytree of arrays alone."""

    parts: Partitioned

    @classmethod
    def of(cls, function: Callable[..., Any]) -> "Law":
        if isinstance(function, Law):
            return function
        return cls(Partitioned.split(jax.tree.map(_number, function)))

    def __call__(self, *arguments: Any) -> Any:
        return self.parts.combine()(*arguments)


def _number(x: Any) -> Any:
    """A leaf of a function, as an array if it is a number."""
    if isinstance(x, float):
        return as_array(x)
    return as_jax(x) if isinstance(x, jax.Array | np.ndarray) else x


class Labelled(eqx.Module):
    """A measurement of a coordinate, a rate or a state by its `label`."""

    label: str = eqx.field(static=True)

    def __call__(self, system: Any, t: Time, q: Array, v: Array) -> Float[Array, ""]:
        column, is_rate = self.place(system.full.structure.labels)
        state = system.state(t, q, v)
        measured: Array = (state.v if is_rate else state.q)[column]
        return measured

    def place(self, labels: tuple[str, ...]) -> tuple[int, bool]:
        """The number of the coordinate, and whether it is its rate; SceneError if there is none."""
        column = find(self.label, labels)
        if column is None:
            raise SceneError(
                f"Sampled: it measures '{self.label}', which is no coordinate; there are: "
                f"{', '.join(labels)}."
            )
        return column


def _measured(given: Iterable[Any]) -> tuple[Any, ...]:
    return tuple(Labelled(x) if isinstance(x, str) else x for x in given)


class Sampled(AbstractEffect):
    """A controller with a clock: at each multiple of its period it measures, computes and sets
    signals, which hold their values up to the next tick,

        (u, x) ← function(t, x, measured).

    Steps of a run end at the ticks. It acts by the effects whose signals are `Held("name")`, such
    as a `Torque` or an `Actuator`. Derivatives pass through the function, whatever is in it, such
    as a module of equinox with its weights, and by the period, with which the ticks move.

    **Arguments:**

    - `period`: between ticks, at its multiples from t = 0 on [s].
    - `function(t, state, measured) -> (values, state)`: with arrays (states,) and (measured,);
      `values` (sets,) are what it sets, or one number of one signal.
    - `measured`: labels of coordinates, rates and states, such as "cart.x'", or quantities of
      `romjax.quantity`.
    - `sets`: the names of its signals; runs have them as `run["name.signal"]`, at a tick as they
      were before.
    - `state` (states,): its memory at the start, `run["name.state1"]`; none unless given.
    - `name`: of the controller.

    Signals are zero before the first tick. Controllers that tick at once do so in the order of the
    scene. Raises SceneError for a period that is not positive, and names that are given twice.
    """

    period: Converted[Float[Array, ""]] = number()
    function: Converted[Callable[..., Any], Callable[..., Any]] = eqx.field(converter=Law.of)
    measured: Converted[tuple[Any, ...], Iterable[Any]] = eqx.field(converter=_measured)
    sets: Converted[tuple[str, ...], Iterable[str]] = eqx.field(static=True, converter=tuple)
    state: Converted[Float[Array, " states"], Vector] = number(default=())
    name: str = eqx.field(static=True, default="controller")

    @property
    def markers(self) -> tuple[Marker, ...]:
        return ()

    @property
    def states(self) -> tuple[str, ...]:
        """The names of its numbers: those of its memory, then its signals."""
        return (*(f"state{i + 1}" for i in range(len(self.state))), *self.sets)

    def initial(self) -> Float[Array, " numbers"]:
        """The numbers at the start."""
        return concatenate([self.state, np.zeros(len(self.sets), self.state.dtype)])

    def is_tick(self, t: Time) -> Array:
        """Whether a time is one of its ticks, but for rounding."""
        phase = jnp.asarray(t / self.period)
        return jnp.abs(phase - jnp.round(phase)) < _near(phase)

    def until_tick(self, t: Time) -> Float[Array, ""]:
        """How long it is to the next tick [s]."""
        phase = jnp.asarray(t / self.period)
        return (jnp.floor(phase + _near(phase)) + 1) * self.period - t

    def tick_near(self, t: Time) -> Float[Array, ""]:
        """The time of its tick that is nearest to t [s]."""
        return jnp.round(jax.lax.stop_gradient(t / self.period)) * self.period

    def ticked(self, t: Time, numbers: Array, measured: Array) -> Float[Array, " numbers"]:
        """Its numbers after a tick."""
        count = len(self.state)
        values, state = self.function(t, numbers[:count], measured)
        values, state = jnp.atleast_1d(jnp.asarray(values)), jnp.atleast_1d(jnp.asarray(state))
        for what, value, wanted in (("values", values, len(self.sets)), ("state", state, count)):
            if value.shape != (wanted,):
                raise SceneError(
                    f"Sampled '{self.name}': its function returns {what} of shape {value.shape}, "
                    f"but it must be ({wanted},)."
                )
        return jnp.concatenate([state, values]).astype(numbers.dtype)

    def check(self) -> None:
        owner = f"effect '{self.name}'"
        check_numbers(owner, self, "period", sign="positive")
        check_numbers(owner, self, "state", shape=(None,))
        if not self.sets or len(set(self.sets)) < len(self.sets):
            raise SceneError(
                f"{owner}: sets is {self.sets}; give a name of its own to each signal."
            )


def _near(phase: Float[Array, ""]) -> Float[Array, ""]:
    """The share of a period that counts as none, at so many periods."""
    return jnp.maximum(_NEAR, _ROUNDING * jnp.finfo(phase.dtype).eps * jnp.abs(phase))
