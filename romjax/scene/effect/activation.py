"""The state of an actuator between its signal and its force."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import concrete
from ...common.errors import SceneError
from ..fields import Converted, check_numbers, number
from ..limits import check_limits, cut_off


class Activation(eqx.Module):
    """A state a of an `Actuator` that takes the place of its signal u: a filter τ a' = u − a or,
    without a time constant, an integrator a' = u.

    It stops at `least` and at `largest`, and leaves them as soon as its rate turns round.

    **Arguments:**

    - `time_constant`: τ [s]; a' = u unless given.
    - `least`, `largest`: of a; none unless given.
    - `start`: a at the start, within the limits.

    a, its limits and its start have the unit of the signal, which integrates per second without a
    time constant. An `Actuator` with it raises SceneError for a time constant that is not positive,
    for limits in the wrong order and for a start beyond them.
    """

    time_constant: Converted[Float[Array, ""] | None] = number(default=None)
    least: Converted[Float[Array, ""] | None] = number(default=None)
    largest: Converted[Float[Array, ""] | None] = number(default=None)
    start: Converted[Float[Array, ""]] = number(default=0.0)

    def rate(self, signal: Float[Array, ""], state: Float[Array, ""]) -> Float[Array, ""]:
        """The rate a' of the state a, per second; `signal` (), `state` ()."""
        rate = signal if self.time_constant is None else (signal - state) / self.time_constant
        # At a limit only rates that lead back inside are left: the state does not wind up.
        if self.least is not None:
            rate = jnp.where(state <= self.least, jnp.maximum(rate, 0), rate)
        if self.largest is not None:
            rate = jnp.where(state >= self.largest, jnp.minimum(rate, 0), rate)
        return rate

    def value(self, state: Float[Array, ""]) -> Float[Array, ""]:
        """Return the activation a in place of the signal; a step may have gone beyond a limit."""
        return cut_off(state, self.least, self.largest)

    def check(self, owner: str) -> None:
        """Check the numbers for an actuator, by which messages begin.

        Raises SceneError with owner, field, value and remedy.
        """
        check_numbers(owner, self, "time_constant", sign="positive", prefix="Activation.")
        check_numbers(owner, self, "start", prefix="Activation.")
        check_limits(owner, self, prefix="Activation.")
        start = concrete(self.start)
        low, high = (
            end if limit is None else concrete(limit)
            for limit, end in ((self.least, -np.inf), (self.largest, np.inf))
        )
        if start is None or low is None or high is None:
            return
        if not np.all((low <= start) & (start <= high)):
            raise SceneError(
                f"{owner}: Activation.start is {start:g}, beyond the limits {low:g} and {high:g}; "
                "let it begin between them.",
                field="start",
            )
