"""Configurations that a motion passed between its snapshots."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, concrete
from .snapshots import SnapshotSet

# Where within a step: the top of a flight is at most 6 % of the flight's height above one of them.
_SHARES = (0.25, 0.5, 0.75)


def passed(snapshots: SnapshotSet) -> Float[Array, "h n"]:
    """The snapshots, and configurations within the steps of motions that these show by the ends of
    their steps, since one step may be a whole flight between two contacts.

    Within a step, they follow the cubic of the positions and velocities at its ends, or where it
    ends at an impact, after which the state there is kept, the parabola of all but that velocity.
    """
    numbers = [concrete(x) for x in (snapshots.t, snapshots.q, snapshots.v)]
    if any(x is None for x in numbers):
        return snapshots.q
    t, q, v = (np.asarray(x) for x in numbers)
    rows, first = [q], 0
    for motion in snapshots.motions:
        states = getattr(motion, "states", None)
        after = first + len((states or motion).t)
        if states is not None:
            own = slice(first, after)
            rows += _within(t[own], q[own], v[own], _jumps(motion))
        first = after
    return snapshots.q if len(rows) == 1 else as_jax(np.concatenate(rows))


def _jumps(motion: Any) -> np.ndarray:
    """When velocities jumped."""
    events = getattr(motion, "events", None)
    if events is None:
        return np.zeros(0)
    times: np.ndarray = np.asarray(events.time)[events.is_impact]
    return times


def _within(t: np.ndarray, q: np.ndarray, v: np.ndarray, jumps: np.ndarray) -> list[np.ndarray]:
    # Where steps were thinned, a jump may lie within. The state at the end fills unused rows.
    inside = (t[:-1, None] < jumps[None]) & (jumps[None] < t[1:, None])
    lasts = (t[1:] > t[:-1]) & ~np.any(inside, axis=1)
    step, change = np.diff(t)[lasts, None], np.diff(q, axis=0)[lasts]
    q, start, end = q[:-1][lasts], v[:-1][lasts], v[1:][lasts]
    # The parabola through both positions with the velocity at the start ends with 2 Δq/h − v₀.
    end = np.where(np.isin(t[1:], jumps)[lasts, None], 2 * change / step - start, end)
    return [
        q + s**2 * (3 - 2 * s) * change + s * (1 - s) * step * ((1 - s) * start - s * end)
        for s in _SHARES
    ]
