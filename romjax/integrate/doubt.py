"""Runs that end, and against which something speaks."""

import contextlib
import contextvars
import dataclasses
import functools
import warnings
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp

from ..common.arrays import concrete
from ..system.base import AbstractSystem
from ..system.flags import WORDS, Flag
from .derived import EagerQuantities
from .singular import singular_position
from .status import REMEDIES, Status
from .trajectory import Trajectory

# What a run is warned of, and what projection may mend. Integers: members of an enumeration take
# ten times as long, and every run is asked.
DOUBTS = int(Flag.ENERGY | Flag.DISSIPATION | Flag.BRANCH | Flag.LIMIT)
_MENDED = int(Flag.ENERGY | Flag.BRANCH)
_LIMIT, _RESOLUTION, _PHASE = int(Flag.LIMIT), int(Flag.RESOLUTION), int(Flag.PHASE)
# Of what runs warn, also whose tolerances are too coarse, within programs and sweeps too.
TOLD = DOUBTS | _RESOLUTION | _PHASE
# In whose name runs within a program tell of themselves when it runs.
_OWNER = contextvars.ContextVar[str | None]("owner", default=None)
_SUCCESS, _VIOLATED = int(Status.SUCCESS), int(Status.CONSTRAINTS_VIOLATED)


def is_doubtful(run: Trajectory) -> bool:
    """Whether one run, not of those that JAX traces, may have lost joints, energy or branch."""
    status, flags = _outcome(run)
    return bool(status == _SUCCESS and flags & _MENDED) or status == _VIOLATED


def _outcome(run: Trajectory) -> tuple[int, int]:
    """Status and flags of one run; −1 and 0 for those that JAX traces, and for several."""
    status, flags = concrete(run.status), concrete(run.flags)
    if status is None or flags is None or status.ndim:
        return -1, 0
    return int(status), int(flags)


def is_unresolved(run: Trajectory) -> bool:
    """Whether one run, not of those that JAX traces, ended, but resolves its motion too little."""
    status, flags = _outcome(run)
    return status == _SUCCESS and bool(flags & _RESOLUTION)


def _tolerances(run: Trajectory) -> str:
    return ", ".join(f"{name} = {float(getattr(run.stats, name)):.1e}" for name in ("rtol", "atol"))


@contextlib.contextmanager
def telling(owner: str) -> Iterator[None]:
    """Runs that JAX traces within it warn, in the name of `owner`, when their program runs."""
    token = _OWNER.set(owner)
    try:
        yield
    finally:
        _OWNER.reset(token)


def warn_of_outcome(owner: str, status: Any, flags: Any) -> None:
    """Warn, in the name of `owner`, of a run that failed or is doubtful, by its numbers."""
    # Within a program no run is repeated with tolerances for its size.
    failed, doubts = int(status) != _SUCCESS, int(flags) & TOLD
    if failed:
        words = f"a run failed: {REMEDIES[Status(int(status))]}"
    else:
        words = "a run is doubtful: " + "; ".join(w for flag, w in WORDS.items() if doubts & flag)
    if failed or doubts:
        warnings.warn(f"{owner}: {words}. Simulate it there to see more.", stacklevel=3)


def without_failures(run: Trajectory) -> Trajectory:
    """The run, but where somebody is `telling`, NaN of one that failed, whose numbers may be
    finite: joints that come apart, say, or more impacts than there is room for.
    """
    if _OWNER.get() is None:
        return run
    failed = run.status != _SUCCESS
    known = concrete(failed)
    if known is not None and not known.any():
        return run

    def hide(x: Any) -> Any:
        return jnp.where(failed, jnp.nan, x)

    derived = run.derived
    if isinstance(derived, EagerQuantities):
        derived = derived._replace(multipliers=hide(derived.multipliers))
    else:
        derived = dataclasses.replace(derived, q=hide(derived.q), v=hide(derived.v))
    return dataclasses.replace(run, q=hide(run.q), v=hide(run.v), derived=derived)


def warn_of_doubt(system: AbstractSystem, run: Trajectory) -> None:
    """Warn of one run that ended, of what speaks against it; of those that JAX traces, where
    somebody is `telling`.
    """
    owner = _OWNER.get()
    if owner is not None and concrete(run.status) is None:
        # Only where there is something to say: leaving the program takes as long as a small run.
        speaks = (run.status != _SUCCESS) | (run.flags & TOLD != 0)
        tell = functools.partial(jax.debug.callback, functools.partial(warn_of_outcome, owner))
        jax.lax.cond(speaks, tell, lambda *_: None, run.status, run.flags)
    status, flags = _outcome(run)
    if owner is not None and status > _SUCCESS:
        warn_of_outcome(owner, status, flags)
    if status == _SUCCESS and flags & _RESOLUTION:
        warnings.warn(
            f"simulate: {WORDS[Flag.RESOLUTION]}: it takes {_tolerances(run)}. Choose rtol and "
            "atol for its size, or units in which it is larger.",
            stacklevel=3,
        )
    if status == _SUCCESS and flags & _PHASE:
        warnings.warn(
            f"simulate: {WORDS[Flag.PHASE]}: it takes {_tolerances(run)}. The error goes with rtol "
            "and with the square of the turns, swings or bounces: choose a smaller rtol.",
            stacklevel=3,
        )
    if status != _SUCCESS or not flags & DOUBTS:
        return
    words = [f"simulate: the motion is doubtful: {run.warnings()}"]
    singular = singular_position(system, run)
    if singular is not None and singular.is_passed:
        words.append(singular.describe())
    numerical = flags & DOUBTS & ~_LIMIT
    remedies = ["Tighten rtol, or use stabilization=romjax.Projection()."] if numerical else []
    if flags & _LIMIT:
        remedies.append("Where a part turns far, use a joint with a TorsionSpring, which counts.")
    warnings.warn(". ".join(["; ".join(words), " ".join(remedies)]), stacklevel=3)
