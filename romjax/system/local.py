"""The system in which the coordinates of an integrated state are its own."""

from typing import Any

from .base import AbstractSystem


def local_system(system: AbstractSystem, post_step: Any, y: Any) -> AbstractSystem:
    """Return the system in the chart of a state (q, v) or (q, v, chart).

    `post_step`: what changes the chart between steps; it is not asked for a state without one.
    """
    if len(y) < 3:
        return system
    local: AbstractSystem = post_step.in_chart(system, y[2])
    return local
