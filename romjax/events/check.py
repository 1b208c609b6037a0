"""Checks of the events that users pass."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..common import compat
from ..common.errors import InputError
from ..system.base import AbstractSystem
from .base import AbstractEvent


def check_events(events: Sequence[AbstractEvent], most: int) -> tuple[AbstractEvent, ...]:
    """The events as a tuple. Raises InputError for what is no event, wrong numbers, or no room."""
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
