"""The run of a model that knows more, as accurate as what it is to tell asks for."""

import dataclasses
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import concrete
from ...common.compat import is_outermost
from ...compiling.program import program
from ...integrate.default import start_frequencies
from ...integrate.error_bar import ErrorBar
from ...integrate.group_errors import groups_with_members, resolution
from ...integrate.rodas5p import Rodas5P
from ...integrate.simulate import simulate
from ...integrate.status import Status
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from ..compare import errors_between

# The tolerance of a richer run beside one in fixed steps, and of a first one beside others: the
# error of most models is far larger, and steps are half as many as at 1e-8.
_USUAL = 1e-6
# Errors that are told well enough, in tolerances: by any method, and by Rodas5P, which steps over
# vibrations whose joint forces both models then miss alike.
_ENOUGH, _STEPPED_OVER = 20.0, 1e3
# Where these vibrations are followed, forces have the share of accelerations in their tolerance.
_SHARPER = 1e-2
# No tolerance is below, in units in the last place: rounding errors of some steps.
_DIGITS = 500
# Steps of Dopri8 up to which that costs no more than Rodas5P at the tolerance of the run does where
# they are excited (measured: 1800 steps and 2250), and how long they are, over the frequency.
_FOLLOWED, _STABLE = 3000.0, 4.0


def told_by(model: AbstractSystem, run: Trajectory, name: str) -> Trajectory:
    """The motion of a model that knows more, at the times of a run, and what it tells of that.

    Its tolerance is at first that which most errors ask for. Where the error is so small that this
    does not resolve it, it is that of the run; and where that error is one of vibrations that an
    implicit method steps over, they are followed by an explicit one if that is affordable.
    """
    rtol = concrete(_tolerance(run))
    if rtol is None or rtol >= _USUAL or not is_outermost():
        return told(run, simulated(model, run), name)
    first = told(run, simulated(model, run, _USUAL), name)
    assert first.bar is not None
    error, stiff = concrete(first.bar.error), isinstance(first.solver, Rodas5P)
    if error is None or _USUAL * (_STEPPED_OVER if stiff else _ENOUGH) <= error < np.inf:
        return first
    if stiff and _can_follow(model, run):
        sharper = min(float(rtol), max(_SHARPER * float(rtol), _DIGITS * np.finfo(run.q.dtype).eps))
        other = simulated(model, run, sharper, diffrax.Dopri8())
        # What is stiff may come after the start, where that it is affordable was seen.
        if other.success:
            return told(run, other, name)
    return told(run, simulated(model, run), name)


def _can_follow(model: AbstractSystem, run: Trajectory) -> bool:
    """Whether an explicit method takes few enough steps along the fastest vibration."""
    fastest = concrete(start_frequencies(model, run.t, model.q0, model.v0).fastest)
    if fastest is None or model.structure.contacts:
        return False
    return bool(fastest * (run.t[-1] - run.t[0]) / _STABLE <= _FOLLOWED)


def _tolerance(run: Trajectory) -> Float[Array | np.ndarray, ""] | float:
    return _USUAL if run.stats.rtol is None else run.stats.rtol


def simulated(
    model: AbstractSystem,
    run: Trajectory,
    rtol: float | None = None,
    solver: diffrax.AbstractSolver[Any] | None = None,
) -> Trajectory:
    """A model at the times of a run, at its tolerance and by the method that suits the model unless
    others are given.
    """
    tolerance = _tolerance(run) if rtol is None else rtol
    # It has a balance of energy where the run has one, so that energies of both can be compared.
    audit = run.balance is not None
    return simulate(model, run.t, rtol=tolerance, solver=solver, throw=False, audit=audit)


def told(run: Trajectory, other: Trajectory, name: str, blind: str = "") -> Trajectory:
    """The other run, and what it tells of the first one; `blind`: what it is known not to tell."""
    statuses = run.status, other.status
    motions = other.q, run.q, other.metric
    groups, members = groups_with_members(other.coordinates, other.q.dtype)
    by_groups = members, resolution(other, run)
    errors, flags = _judged(*motions, statuses, other.flags, *by_groups, other.quaternions)
    error, per_group = errors
    bar = ErrorBar(error, name, per_group, groups, blind)
    return dataclasses.replace(other, bar=bar, flags=flags)


@program
def _judged(
    other: Float[Array, "k n"],
    own: Float[Array, "k n"],
    metric: Float[Array, "n n"],
    statuses: tuple[Array, Array],
    flags: Array,
    members: Float[Array | np.ndarray, "n g"],
    resolved: Float[Array | np.ndarray, ""],
    quaternions: tuple[int, ...],
) -> tuple[tuple[Array, Array], Array]:
    """The error of a motion and of its groups of coordinates, and the flags of the other one, which
    tells it; infinite where one of both has failed.
    """
    error, per_group = errors_between(other, own, metric, members, resolved, quaternions)
    ended = (statuses[0] == Status.SUCCESS) & (statuses[1] == Status.SUCCESS)
    error = jnp.where(ended, error, jnp.inf)
    return (error, per_group), flags | ErrorBar(error, "").flags
