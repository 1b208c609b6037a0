"""Configurations that a motion passed between its snapshots."""

import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, concrete
from .snapshots import SnapshotSet

# Where within a step: the top of a flight is at most 6 % of the flight's height above one of them.
_SHARES = (0.25, 0.5, 0.75)


def passed(snapshots: SnapshotSet) -> Float[Array, "h n"]:
    """The snapshots, and configurations within the steps of motions that these show by the ends of
    their steps, since one step may be a whole flight between two contacts.

    Within a step, they follow the cubic of the positions and velocities at its ends.
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
            rows += _within(t[own], q[own], v[own])
        first = after
    return snapshots.q if len(rows) == 1 else as_jax(np.concatenate(rows))


def _within(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    step, change = np.diff(t)[:, None], np.diff(q, axis=0)
    return [
        q[:-1] + s**2 * (3 - 2 * s) * change + s * (1 - s) * step * ((1 - s) * v[:-1] - s * v[1:])
        for s in _SHARES
    ]
