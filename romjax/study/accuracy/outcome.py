"""The outcome of a run: its errors, its steps, or why it failed."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import numpy as np

from ...common.arrays import as_jax
from ...integrate.rodas5p import Rodas5P
from ...integrate.status import Status
from ...integrate.trajectory import Trajectory
from ..compare import apart, compare


class Outcome(NamedTuple):
    """The result of a run, or of several lanes at once."""

    error: float  # of the worst lane; NaN where one failed
    history: np.ndarray  # (k,) of the first lane, at each output time
    steps: int
    failure: str


def outcome_of(motion: Trajectory, reference: Trajectory) -> Outcome:
    """The errors of a motion, or of several at once, against the reference."""
    status = np.ravel(motion.status)
    steps = round(float(np.mean(motion.stats.num_steps)))
    failed = status[status != Status.SUCCESS]
    if failed.size:
        blank = np.full(len(reference.t), np.nan)
        return Outcome(np.nan, blank, steps, Status(int(failed[0])).name)
    # In the precision of the reference, so that the comparison adds no error of its own.
    wide = eqx.tree_at(lambda run: run.q, motion, as_jax(_wide(motion.q, reference)))
    every = jax.vmap(compare, (None, 0)) if motion.q.ndim > reference.q.ndim else compare
    error = float(np.max(every(reference, wide).error))
    return Outcome(error, _history(motion, reference), steps, "")


def _history(motion: Trajectory, reference: Trajectory) -> np.ndarray:
    """‖M₀^½ (q̃ − q)(t)‖ of the first lane over the largest ‖M₀^½ (q − q₀)‖."""
    root = np.linalg.cholesky(reference.metric)
    known, columns = np.asarray(reference.q), reference.quaternions
    first = _wide(motion.q, reference).reshape(-1, *known.shape)[0]
    own, start = (as_jax(x) for x in (first, np.broadcast_to(known[:1], known.shape)))
    errors, motions = (apart(reference.q, q, columns) for q in (own, start))
    error, reach = (np.linalg.norm(np.asarray(x) @ root, axis=1) for x in (errors, motions))
    history: np.ndarray = error / (np.max(reach) or 1.0)
    return history


def _wide(q: Any, reference: Trajectory) -> np.ndarray:
    """Configurations in the precision of the reference; by NumPy, which compiles nothing."""
    return np.asarray(q).astype(reference.q.dtype)


def work_of_a_step(solver: diffrax.AbstractSolver[Any]) -> tuple[int, int]:
    """Right-hand sides and factorisations of one step; zero where an iteration decides."""
    if isinstance(solver, Rodas5P):
        return 8, 1
    tableau = getattr(solver, "tableau", None)
    if isinstance(solver, diffrax.AbstractERK) and isinstance(tableau, diffrax.ButcherTableau):
        return tableau.num_stages - int(tableau.fsal), 0
    return 0, 0
