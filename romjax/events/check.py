"""Checks of the events that users pass."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import compat
from ..common.compat import is_traced
from ..common.errors import InputError
from ..compiling.program import program_once
from ..system.base import AbstractSystem
from .base import AbstractEvent

# Two values of one quantity differ by rounding; and the share of a state by which another one is
# apart from it.
_ALIKE, _BESIDE = 1e-6, 1e-2


def check_events(
    events: Sequence[AbstractEvent],
    most: int,
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> tuple[AbstractEvent, ...]:
    """The events of a run of a `system` as a tuple. Raises InputError for what is no event, wrong
    numbers, no room, or a function that takes reduced coordinates for physical ones.
    """
    if isinstance(events, AbstractEvent):
        events = (events,)
    if most < 1:
        raise InputError(f"simulate: max_events = {most} must be at least 1.")
    for i, event in enumerate(events):
        if not isinstance(event, AbstractEvent):
            raise InputError(
                f"simulate: events[{i}] is a {type(event).__name__}; give a romjax.Crossing, Stop "
                "or Impact."
            )
        event.check()
    _check_states(system, ts, q, v, events)
    return tuple(events)


def check_quantities(system: AbstractSystem, events: Sequence[AbstractEvent]) -> None:
    """Raise InputError for an event that gives no number of this system or jumps, or an impact
    whose gap depends on velocities.
    """
    # Velocities of reduced coordinates would be used for those of the physical ones in any case.
    full = system.full
    t, q, v = jnp.zeros((), full.q0.dtype), full.q0, full.v0
    for i, event in enumerate(events):

        def value(v: Array, t: Array, q: Array, event: AbstractEvent = event) -> Array:
            return event.value(full, t, q, v)

        if getattr(event.of, "jumps", False):
            raise InputError(
                f"simulate: events[{i}] watches a {type(event.of).__name__}, which jumps by a full "
                "turn in space, as if it crossed its level; watch what does not, such as the sine "
                "of what the angle is above the level, a function of (system, t, q, v)."
            )
        shape = jax.eval_shape(value, v, t, q).shape
        if shape != ():
            raise InputError(
                f"simulate: events[{i}] gives an array of shape {shape}; its quantity must be one "
                "number."
            )
        if event.resets and compat.depends_on_first(value, v, t, q):
            raise InputError(
                f"simulate: the gap of events[{i}] depends on velocities; an Impact closes a "
                "distance, a travel or an angle."
            )


def _check_states(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    events: Sequence[AbstractEvent],
) -> None:
    """Raise InputError for a function that takes the coordinates of a reduced `system` for physical
    ones, which gives another number there than of the mechanism in the same state.
    """
    own = [event for event in events if not hasattr(event.of, "jumps")]
    numbers = (system, ts, q, v, own)
    if system.full is system or not own or any(is_traced(x) for x in jax.tree.leaves(numbers)):
        return
    check_quantities(system, events)
    values, others = (np.asarray(x) for x in _both(system, ts[0], q, v, tuple(own)))
    differ = np.abs(values - others) > _ALIKE * (1 + np.abs(values) + np.abs(others))
    if np.any(differ):
        first = int(np.argmax(differ))
        raise InputError(
            f"simulate: the function that events[{list(events).index(own[first])}] watches gives "
            f"{values[first]:.6g} of the reduced model and {others[first]:.6g} of the mechanism in "
            "the same state: q and v are reduced coordinates there. Take the physical ones, "
            "system.state(t, q, v).q and .v, or a romjax.quantity."
        )


@program_once
def _both(
    system: AbstractSystem, t: Array, q: Array, v: Array, events: tuple[AbstractEvent, ...]
) -> tuple[Float[Array, " events"], Float[Array, " events"]]:
    """What events watch near a state, of a model and of its mechanism."""
    # Beside the start: both kinds of coordinates may be zero there.
    apart = _BESIDE * jnp.cos(jnp.arange(1, len(q) + 1, dtype=q.dtype))
    q, v = q + apart * (1 + jnp.abs(q)), v + apart * (1 + jnp.abs(v))
    state = system.state(t, q, v)
    values = [event.value(system, t, q, v) for event in events]
    others = [event.value(system.full, t, state.q, state.v) for event in events]
    return jnp.stack(values), jnp.stack(others)
