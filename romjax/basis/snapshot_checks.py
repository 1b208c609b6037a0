"""Checks of snapshots before anything is decomposed."""

from typing import Any

import numpy as np

from ..common.arrays import concrete
from ..common.errors import InputError


def check_snapshots(owner: str, t: Any, q: Any, v: Any) -> None:
    """Raise InputError, beginning with `owner`, for snapshots that are not finite, and for times
    that go back; nothing is asked while JAX traces.
    """
    times, *others = (concrete(x) for x in (t, q, v))
    if not all(x is None or np.all(np.isfinite(x)) for x in (times, *others)):
        raise InputError(f"{owner}: the snapshots are not finite; did the simulation succeed?")
    if times is None:
        return
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        at, after = times[back[0] : back[0] + 2]
        raise InputError(
            f"{owner}: the times of a motion go back, from {at:g} to {after:g} s; give snapshots "
            "in the order of time, and several motions each by itself."
        )
