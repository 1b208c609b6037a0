"""Events: moments at which a quantity of the state passes a level."""

import inspect
from collections.abc import Callable
from typing import ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..common.checks import check_finite, check_shape
from ..common.errors import InputError
from ..common.fields import Converted, number
from ..system.base import AbstractSystem

__all__ = ["AbstractEvent", "Crossing", "Stop"]

# A number of the state, by (system, t, q, v): a `romjax.quantity`, or any function like it.
Quantity = Callable[[AbstractSystem, Time, Array, Array], Array]
Direction = Literal["falling", "rising", "both"]


class AbstractEvent(eqx.Module):
    """A moment at which the quantity `of` passes a `level`.

    - `direction`: in which it passes. `stops`: whether the run ends there. `resets`: whether
      velocities change there.
    """

    of: eqx.AbstractVar[Quantity]
    level: eqx.AbstractVar[Float[Array, ""]]
    direction: eqx.AbstractVar[Direction]
    stops: eqx.AbstractClassVar[bool]
    resets: eqx.AbstractClassVar[bool]

    def value(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Array:
        """The quantity above its level, at a state of a full or reduced `system`."""
        return self.of(system, t, q, v) - self.level

    def check(self) -> None:
        """Raise an InputError that names the argument, its value and the remedy."""
        owner = type(self).__name__
        if not callable(self.of) or not _takes_states(self.of):
            raise InputError(
                f"{owner}: of = {self.of!r} is no function of (system, t, q, v); use one of "
                "romjax.quantity, or write such a function."
            )
        check_shape(owner, "level", self.level, ())
        check_finite(owner, "level", self.level)
        if self.direction not in ("falling", "rising", "both"):
            raise InputError(
                f"{owner}: direction = {self.direction!r} must be 'falling', 'rising' or 'both'."
            )


def _takes_states(function: Quantity) -> bool:
    """Whether a function can be called with four arguments, as far as it says what it takes."""
    try:
        # What a decorator wraps may take something else.
        signature = inspect.signature(function, follow_wrapped=False)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind(*["system", "t", "q", "v"])
    except TypeError:
        return False
    return True


class Crossing(AbstractEvent):
    """A moment to take note of.

    **Arguments:**

    - `of`: a `romjax.quantity`, or any function of (system, t, q, v) that gives one number. In runs
      of a reduced system q and v are its own, and the physical ones `system.state(t, q, v).q` and
      `.v`; a function that takes the ones for the others is refused where JAX does not trace.
    - `level`: that it passes, in its unit. `direction`: "falling", "rising" or "both".
    """

    of: Quantity
    level: Converted[Float[Array, ""]] = number(default=0.0)
    direction: Direction = eqx.field(static=True, default="both")
    stops: ClassVar[bool] = False
    resets: ClassVar[bool] = False


class Stop(AbstractEvent):
    """A moment at which the run ends: later outputs are those at this time, their `t` included.

    **Arguments:** those of a `Crossing`.
    """

    of: Quantity
    level: Converted[Float[Array, ""]] = number(default=0.0)
    direction: Direction = eqx.field(static=True, default="both")
    stops: ClassVar[bool] = True
    resets: ClassVar[bool] = False
