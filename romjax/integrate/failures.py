"""Failures of simulations in words."""

import equinox as eqx
import numpy as np

from ..common.arrays import concrete
from ..common.errors import SimulationError
from ..system.base import AbstractSystem
from ..system.flags import WORDS
from ..system.start import Start
from .doubt import DOUBTS
from .status import REMEDIES, Status
from .trajectory import Trajectory

# A run that is so many of its lengths away from zero may fail for the digits of its times.
_LATE = 1e4


def raise_failure(system: AbstractSystem, trajectory: Trajectory, start: Start) -> Trajectory:
    """The same trajectory; raise if it failed, while JAX traces when the program runs, and then of
    doubts too, of which no warning is possible.

    `start`: the constraints at the start of the run. Raises ValueError for a start that violates
    them, SimulationError for everything else.
    """
    number = concrete(trajectory.status)
    if number is None:
        failed = trajectory.status != Status.SUCCESS
        words = "; or ".join(remedy for remedy in REMEDIES.values() if remedy)
        q = eqx.error_if(trajectory.q, failed, f"A simulation failed: {words}.")
        doubts = "; or ".join(words for flag, words in WORDS.items() if flag & DOUBTS)
        q = eqx.error_if(
            q,
            trajectory.flags & DOUBTS != 0,
            f"A simulated motion is doubtful: {doubts}. Tighten rtol, use "
            "stabilization=romjax.Projection(), or with throw=False look at Trajectory.flags.",
        )
        checked: Trajectory = eqx.tree_at(lambda run: run.q, trajectory, q)
        return checked
    # As integers: an array is compared with a member of an enumeration ten times as slowly.
    status = int(number)
    if status == int(Status.SUCCESS):
        return trajectory
    if status == Status.INCONSISTENT_START:
        raise ValueError(_describe_start(system, start, float(trajectory.t[0])))
    steps = int(trajectory.stats.num_steps)
    raise SimulationError(
        f"simulate: {trajectory.solver_name} took {steps} steps towards "
        f"t = {float(trajectory.t[-1]):g} s and failed: {trajectory.summary()}."
        + _describe_times(np.asarray(trajectory.t))
    )


def _describe_times(t: np.ndarray) -> str:
    """Say why a run that begins long after zero may have failed."""
    latest, length = max(abs(t[0]), abs(t[-1])), t[-1] - t[0]
    if not 0 < _LATE * length <= latest:
        return ""
    return (
        f" Times near {latest:g} s are told apart by {np.spacing(latest):.1g} s, which may be too "
        "coarse for the steps of this run: let it begin at 0, and signals as much earlier."
    )


def _describe_start(system: AbstractSystem, start: Start, t: float) -> str:
    """The constraint that a start at `t` violates most, for what is allowed, and by how much."""
    row, fastest = start.worst(), start.worst_rate()
    which, value, unit = "C", start.violation[row], "m or rad"
    if start.closed:
        row = fastest
        which, value, unit = "its rate", start.rate[row], "m/s or rad/s"
    remedy = "Use q0, v0 = romjax.consistent(system, q0, v0)"
    if t:
        # Scenes are made consistent at zero, where drives without an offset begin.
        remedy = (
            f"The run begins at t = {t:g} s and scenes at 0: let it begin there too, or use q0, v0 "
            f"= romjax.consistent(system, q0, v0, t={t:g})"
        )
    elif system.structure.frames:
        remedy = (
            "Use romjax.consistent_scene(scene), which keeps the speeds that are set, or q0, v0 = "
            "romjax.consistent(system, q0, v0)"
        )
    return (
        f"simulate: the start violates {system.structure.constraints[row]}: {which} = "
        f"{float(value):.6g} {unit}. {remedy}."
    )
