"""The error of a reduced model on one motion that it was made of."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..common.arrays import concrete
from ..common.compat import is_traced
from ..linalg.quaternions import columns as quaternion_columns
from ..system.base import AbstractSystem
from ..system.structure import Structure
from .error_bar import hidden
from .group_errors import group_errors, groups_with_members, resolution
from .repeated import impacts_of
from .trajectory import Trajectory

# Numbers and starts are the training's where they are as near as rounding allows.
_SAME = 1e-9
# Displacements below, relative to where a body is, are rounding errors of a mechanism at rest.
_REST = 1e-10
# A motion as long as the training may be shorter by rounding.
_SLACK = 1e-9
# By such a share of a run an impact at its end may come too late for it.
_NEARLY = 1e-2


class TrainingError(NamedTuple):
    """The error of a model on one motion that it was made of, up to each of its times.

    - `elapsed` (k,) [s]: since the start.
    - `error` (k,): how far off the position of a body was at most, over the longest way of one; of
      other coordinates where no body moves. Infinite where the model fails.
    - `rtol`: of the less accurate one of both runs, or the error that was asked of the model.
    - `numbers`: those of the system that moved; `start`: (t, q, v) of the model's motion;
      `impacts` (i,) [s]: since the start, when velocities changed in the motion.
    - `hidden`: the group of coordinates that errs most, in words, where the error of all does not
      show it, as `Comparison.hidden`; `missed`: its error, over the motion of all.
    """

    elapsed: Float[np.ndarray, " k"]
    error: Float[np.ndarray, " k"]
    rtol: float
    numbers: tuple[Any, ...] = ()
    start: tuple[Any, ...] = ()
    impacts: Float[np.ndarray, " i"] = np.zeros(0)
    hidden: str = ""
    missed: float = 0.0

    def is_of(self, run: Trajectory, system: AbstractSystem) -> Any:
        """Whether a run of a system is this motion, or a part of it from its start on."""
        numbers = _numbers(system)
        if len(numbers) != len(self.numbers):
            return np.zeros((), bool)
        pairs = list(zip(self.numbers, numbers, strict=True))
        pairs += zip(self.start, (run.t[0], run.q[0], run.v[0]), strict=True)
        others = [(one, other) for one, other in pairs if one is not other]
        span: Any = run.t[-1] - run.t[0]
        traced = any(is_traced(x) for x in (span, *(other for _, other in others)))
        xp: Any = jnp if traced else np
        same = xp.asarray(span) <= self.elapsed[-1] * (1 + _SLACK)
        for one, other in others:
            size = 1 + np.max(np.abs(one), initial=0.0)
            same &= xp.max(xp.abs(xp.asarray(other) - np.asarray(one)), initial=0.0) <= _SAME * size
        return same & self._is_struck_as(run, span)

    def _is_struck_as(self, run: Trajectory, span: Any) -> Any:
        """Whether a run of a `span` [s] has as many impacts as this motion has in that time."""
        count = 0 if run.events is None else run.events.is_impact.sum()
        xp: Any = np if concrete(span) is not None else jnp
        least, most = (xp.sum(self.impacts <= x * span) for x in (1 - _NEARLY, 1 + _NEARLY))
        return (least <= count) & (count <= most)

    def after(self, span: Any) -> Any:
        """The error after a `span` [s]; that of the end after a longer one."""
        xp: Any = np if isinstance(span, np.ndarray) else jnp
        last = xp.searchsorted(self.elapsed, span * (1 + _SLACK), side="right") - 1
        return xp.asarray(self.error)[last]


def _numbers(system: AbstractSystem) -> tuple[Any, ...]:
    """The numbers of the mechanism, in a fixed order."""
    leaves = jax.tree.leaves(system.full)
    return tuple(x for x in leaves if hasattr(x, "dtype") and jnp.issubdtype(x.dtype, jnp.inexact))


def error_of(
    motion: Trajectory, run: Trajectory, rtol: float, q: Float[np.ndarray, "k n"]
) -> TrainingError:
    """The error of a model on a `motion`, by its `run` from the start of that; `rtol` as
    `TrainingError` has it.

    `q`: coordinates of the model at the times of the motion; of no meaning where the run failed.
    """
    # Motions that were made within a transformation of JAX do not know their system.
    times, structure = np.asarray(motion.t), run.system.full.structure
    error, hides = np.full(len(times), np.inf), ("", 0.0)
    if run.success:
        error = _history(structure, np.asarray(motion.q), q)
        if np.all(np.isfinite(q)):
            hides = _hidden(structure, motion, q, resolution(motion, run))
    start = run.t[0], run.q[0], run.v[0]
    struck = impacts_of(motion).time - times[0]
    return TrainingError(times - times[0], error, rtol, _numbers(run.system), start, struck, *hides)


def _hidden(
    structure: Structure, motion: Trajectory, other: np.ndarray, resolved: Any
) -> tuple[str, float]:
    """Return what the error of a motion hides, as `TrainingError` has it."""
    q, other = _alike(structure, np.asarray(motion.q), other)
    metric, way, apart = np.asarray(motion.metric), q - q[:1], other - q
    size, error = (np.sqrt(max(np.sum((x @ metric) * x), 0.0)) for x in (way, apart))
    if not size > 0:
        return "", 0.0
    groups, members = groups_with_members(motion.coordinates, q.dtype)
    weights: Any = np.diagonal(metric)
    whole: Any = np.asarray(size)
    errors = group_errors(apart, way, weights, members, resolved, whole)
    words = hidden(error / size, errors, groups)
    if not words:
        return "", 0.0
    missed = group_errors(apart, way, weights, members, np.asarray(1.0), whole)
    return words, float(missed[np.argmax(errors)])


def _history(structure: Structure, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the largest difference so far over the longest way so far, at each time; of a
    mechanism that rests, over where it is.
    """
    q, other = _alike(structure, q, other)
    ways, apart = np.abs(q - q[:1]), np.abs(other - q)
    moves = np.max(ways, axis=0) > _REST * (1 + np.max(np.abs(q), axis=0))
    places = np.ravel(structure.positions)
    if not np.any(moves):
        # Rounding is no way that errors are relative to.
        return np.maximum.accumulate(np.max(apart / (1 + np.abs(q)), axis=1))
    columns = places if np.any(moves[places]) else np.arange(q.shape[1])
    way, off = (np.maximum.accumulate(np.max(x[:, columns], axis=1)) for x in (ways, apart))
    return np.where(way > 0, off / np.where(way > 0, way, 1), 0)


def _alike(structure: Structure, q: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both motions with quaternions of unit length, and of the signs of the first."""
    if not structure.quaternions:
        return q, other
    q, other = (_of_unit_length(x, structure.quaternions) for x in (q, other))
    table = quaternion_columns(structure.quaternions)
    opposed = np.sum(q[:, table] * other[:, table], axis=2, keepdims=True) < 0
    other[:, table] *= np.where(opposed, -1.0, 1.0)
    return q, other


def _of_unit_length(q: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
    scaled, table = q.copy(), quaternion_columns(starts)
    scaled[:, table] /= np.linalg.norm(q[:, table], axis=2, keepdims=True)
    return scaled
