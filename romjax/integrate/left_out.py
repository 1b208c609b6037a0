"""What the modes of a reduced model leave out, on the motions that it was made of."""

import dataclasses
import operator
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, concrete
from ..common.compat import is_outermost
from ..common.errors import ReductionError
from ..linalg.quaternions import columns as quaternion_columns
from ..system.base import AbstractSystem
from ..system.flags import Flag
from ..system.reduced import AbstractReducedSystem
from ..system.structure import Structure
from ..system.training import Training, training_of
from .trajectory import Trajectory

# A model's motion may be off by so many tolerances, relative to its size, and by the second number
# however sharply the motion is integrated.
_ALLOWED, _LEAST = 100.0, 1e-4
# The least tolerance with which motions are repeated, also in units in the last place; and that for
# motions in fixed steps, which have none.
_SHARPEST, _DIGITS, _USUAL = 1e-8, 100, 1e-6
# Displacements below, relative to where a body is, are rounding errors of a mechanism at rest.
_REST = 1e-10
# A motion as long as the training may be shorter by rounding.
_SLACK = 1e-9

Simulate = Callable[..., Trajectory]


class TrainingError(NamedTuple):
    """The error of a model on one motion that it was made of, up to each of its times.

    - `elapsed` (k,) [s]: since the start.
    - `error` (k,): how far off the position of a body was at most, over the longest way of one; of
      other coordinates where no body moves. Infinite where the model fails.
    - `rtol`: of the less accurate one of both runs.
    """

    elapsed: Float[np.ndarray, " k"]
    error: Float[np.ndarray, " k"]
    rtol: float

    def after(self, span: Any) -> Any:
        """The error after a `span` [s]; that of the end after a longer one."""
        xp: Any = np if isinstance(span, np.ndarray) else jnp
        last = xp.searchsorted(self.elapsed, span * (1 + _SLACK), side="right") - 1
        return xp.asarray(self.error)[last]


def flag_left_out(
    system: AbstractSystem, run: Trajectory, rtol: Any, simulate: Simulate
) -> Trajectory:
    """The run, with `Flag.LEFT_OUT` where it is one of a reduced model that errs by more than a
    hundred tolerances `rtol`, and 1e-4, on the motions that it was made of, in as much time as the
    run takes.

    The model repeats them once, by `simulate` before its first run, also where JAX traces that. It
    is the error of the training and no bound for other motions.
    """
    errors = _errors(system, simulate)
    if not errors:
        return run
    span: Any = run.t[-1] - run.t[0]
    known, tolerance, flags = concrete(span), concrete(rtol), concrete(run.flags)
    if known is None or tolerance is None or flags is None:
        excess = [one.after(span) / _allowed(jnp, rtol, one.rtol) for one in errors]
        doubtful: Array = jnp.max(jnp.stack(excess)) > 1
        return dataclasses.replace(run, flags=run.flags | doubtful * int(Flag.LEFT_OUT))
    if max(one.after(known) / _allowed(np, tolerance, one.rtol) for one in errors) <= 1:
        return run
    return dataclasses.replace(run, flags=as_jax(flags | int(Flag.LEFT_OUT)))


def _allowed(xp: Any, rtol: Any, measured: float) -> Any:
    """The error that a model may have in a run, where it was measured at a tolerance."""
    return xp.maximum(_ALLOWED * xp.maximum(rtol, measured), _LEAST)


def describe(run: Trajectory) -> str:
    """Say for a flag how much a model errs on the motions that it was made of."""
    training = None if run.derived.parts is None else training_of(run.system)
    if training is None or not training.errors:
        return "more modes help"
    error = max(one.after(np.asarray(run.t[-1] - run.t[0])) for one in training.errors)
    much = f"{error:.1e} of the longest way of a body" if np.isfinite(error) else "it fails there"
    return f"{much}; take more modes, as romjax.reduce_to finds them for a tolerance"


def _errors(system: AbstractSystem, simulate: Simulate) -> tuple[TrainingError, ...]:
    """The errors of a model, measured if nobody has; none of what is no model."""
    training = training_of(system)
    if training is None:
        return ()
    if training.errors is None:
        # A thread of its own: JAX traces nothing there, whatever it traces here.
        double = jnp.result_type(float) == jnp.float64

        def measured() -> None:
            with jax.enable_x64(double):
                _measure(training, simulate)

        if is_outermost():
            _measure(training, simulate)
        else:
            with ThreadPoolExecutor(1) as thread:
                thread.submit(measured).result()
    return training.errors or ()


def _measure(training: Training, simulate: Simulate) -> None:
    """Fill in the errors of a model, which needs its motions no longer."""
    found = []
    for number, motion in enumerate(training.motions):
        rom = _beginning_as(training.rom, motion, number == 0) if _is_known(motion) else None
        found += [] if rom is None else [_error(rom, motion, simulate)]
    training.errors, training.motions = tuple(found), ()


def _is_known(motion: Any) -> bool:
    """Whether a motion can be repeated: it is a run of a known system without events."""
    if not isinstance(motion, Trajectory) or motion.derived.parts is None:
        return False
    return motion.events is None and motion.status.ndim == 0 and bool(motion.success)


def _beginning_as(
    rom: AbstractReducedSystem, motion: Trajectory, first: bool
) -> AbstractReducedSystem | None:
    """The model of the system of a motion, from its start; None if it has none. As it was made, it
    starts as the `first` one does.
    """
    full, leaves = motion.system.full, jax.tree.leaves(rom.full)
    others = jax.tree.leaves(full)
    same = len(leaves) == len(others) and all(map(operator.is_, leaves, others))
    if same and first:
        return rom
    try:
        model = rom if same else rom.with_full(full)
        return model.starting_at(motion.q[0], motion.v[0], motion.t[0])
    except ReductionError:
        return None


def _error(rom: AbstractSystem, motion: Trajectory, simulate: Simulate) -> TrainingError:
    """Return the training error of a reduced model on one motion."""
    least = max(_SHARPEST, _DIGITS * float(np.finfo(motion.q.dtype).eps))
    given = _USUAL if motion.stats.rtol is None else float(motion.stats.rtol)
    rtol, times = max(given, least), np.asarray(motion.t)
    error = np.full(len(times), np.inf)
    run = simulate(rom, motion.t, rtol=rtol)
    if run.success:
        error = _history(motion.system.full.structure, np.asarray(motion.q), np.asarray(run.q))
    return TrainingError(times - times[0], error, rtol)


def _history(structure: Structure, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the largest difference so far over the longest way so far, at each time."""
    if structure.quaternions:
        q, other = (_of_unit_length(x, structure.quaternions) for x in (q, other))
        table = quaternion_columns(structure.quaternions)
        opposed = np.sum(q[:, table] * other[:, table], axis=2, keepdims=True) < 0
        other[:, table] *= np.where(opposed, -1.0, 1.0)
    ways, apart = np.abs(q - q[:1]), np.abs(other - q)
    moves = np.max(ways, axis=0) > _REST * (1 + np.max(np.abs(q), axis=0))
    places = np.ravel(structure.positions)
    columns = places if np.any(moves[places]) else np.arange(q.shape[1])
    way, off = (np.maximum.accumulate(np.max(x[:, columns], axis=1)) for x in (ways, apart))
    return np.where(way > 0, off / np.where(way > 0, way, 1), 0)


def _of_unit_length(q: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
    scaled, table = q.copy(), quaternion_columns(starts)
    scaled[:, table] /= np.linalg.norm(q[:, table], axis=2, keepdims=True)
    return scaled
