"""A motion that a reduced model was made of, repeated by the model from one impact to the next."""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..common.arrays import as_jax
from ..common.errors import ReductionError
from ..events.impact import struck
from ..system.reduced import AbstractReducedSystem
from .trajectory import Trajectory

Simulate = Callable[..., Trajectory]
# A model goes on after so many impacts at most, those which the longest motions follow.
_IMPACTS = 16


def undisturbed(motion: Trajectory) -> int:
    """The number of output times until an impact or a stop first changes a motion."""
    first = np.min(impacts_of(motion).time, initial=np.inf)
    return int(np.sum(np.asarray(motion.t)[: _moving(motion)] <= first))


def after_impacts(
    rom: AbstractReducedSystem, motion: Trajectory, begun: Trajectory, rtol: float, run: Simulate
) -> Float[np.ndarray, "k n"]:
    """The coordinates of a model at the times of a `motion`: those of its run `begun` up to the
    first impact, and then from each impact to the next, from where the bodies are at it, with the
    velocities that the model has after it.

    So errors before an impact, that of its time above all, do not count after it. Rows are infinite
    where the model fails, and those of the motion itself where nobody has repeated it.
    """
    q, t = np.array(motion.q), np.asarray(motion.t)
    q[: len(begun.q)] = begun.q
    for impact, rows in _longest(motion):
        try:
            own = rom.starting_at(impact.q, impact.before, impact.time)
        except ReductionError:
            continue
        v = struck(own, own.time, own.q0, own.v0, impact[1:])
        times = np.concatenate([[impact.time], t[rows]])
        goes_on = run(rom.in_chart_of(as_jax(impact.q)), times, rtol=rtol, q0=own.q0, v0=v)
        q[rows] = np.asarray(goes_on.q)[1:] if goes_on.success else np.inf
    return q


class _Impacts(NamedTuple):
    """Impacts, or one of them: when and where they happen, the velocities before and after."""

    time: Any
    q: Any
    before: Any
    after: Any


def impacts_of(motion: Trajectory) -> _Impacts:
    """The events of a motion that change velocities."""
    events = motion.events
    if events is None:
        return _Impacts(*np.zeros((4, 0)))
    rows = (events.time, events.q, events.v_before, events.v_after)
    return _Impacts(*(np.asarray(x)[events.is_impact] for x in rows))


def _longest(motion: Trajectory) -> list[tuple[_Impacts, slice]]:
    """The impacts with the most output times until the next, and these."""
    impacts, t = impacts_of(motion), np.asarray(motion.t)[: _moving(motion)]
    ends = [*np.searchsorted(t, impacts.time, side="right"), len(t)]
    each = [_Impacts(*one) for one in zip(*impacts, strict=True)]
    pieces = [(one, slice(*rows)) for one, rows in zip(each, itertools.pairwise(ends), strict=True)]
    pieces = [(one, rows) for one, rows in pieces if rows.stop > rows.start]
    return sorted(pieces, key=lambda piece: piece[1].start - piece[1].stop)[:_IMPACTS]


def _moving(motion: Trajectory) -> int:
    """The number of output times until a stop, after which times stay as they are."""
    return int(np.sum(np.diff(np.asarray(motion.t), prepend=-np.inf) > 0))
