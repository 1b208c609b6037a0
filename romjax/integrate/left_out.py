"""The error of leaving modes out, on the motions that a reduced model was made of."""

import dataclasses
import functools
import operator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.arrays import as_jax, concrete
from ..common.compat import is_traced
from ..common.errors import ReductionError
from ..common.outside import outside_of_traces
from ..events.base import AbstractEvent
from ..system.base import AbstractSystem
from ..system.flags import Flag
from ..system.reduced import AbstractReducedSystem, reduced_of
from ..system.training import Training, training_error, training_of
from .error_bar import MUCH
from .group_errors import RESOLVED
from .repeated import Simulate, after_impacts, undisturbed
from .training_error import TrainingError, error_of
from .trajectory import Trajectory
from .unmodelled import flag_departure, has_fewer_freedoms

# A model's motion may be off by so many tolerances, relative to its size, and by the second number
# however sharply the motion is integrated.
_ALLOWED, _LEAST = 100.0, 1e-4
# How many times an estimated error of a model another estimate may be.
_TWICE = 2.0
# A model that errs by such a share of a motion that it was not made of promises nothing; nor does
# one that errs by so many tolerances more than the step size control does.
_MARGIN, _STEPS = 0.1, 30.0
# The least tolerance with which motions are repeated, also in units in the last place; and that for
# motions in fixed steps, which have none.
_SHARPEST, _DIGITS, _USUAL = 1e-8, 100, 1e-6


def flag_left_out(
    system: AbstractSystem,
    run: Trajectory,
    rtol: Any,
    simulate: Simulate,
    events: tuple[AbstractEvent, ...] = (),
) -> Trajectory:
    """The run, with `Flag.LEFT_OUT` where it is one of a reduced model that errs by more than a
    hundred tolerances `rtol`, and 1e-4, on the motions that it was made of, in as much time as the
    run takes, or by a tenth of how one body moves or bends; and with `Flag.UNTRIED` where it is
    none of these motions, and the model, of a kind that may err by more elsewhere, errs by more
    than a tenth of that on them.

    A run that is none of these motions, or is struck by impacts of its `events` where they are not,
    has `Flag.UNMODELLED` where forces or impulses move the mechanism out of a model with fewer
    freedoms by as much, as far as `departure` tells, and by more than the double of the error that
    somebody has estimated for the model.

    The model repeats its motions once, by `simulate` before its first run, also where JAX traces
    that. It is the error of the training and no bound for other motions, of which
    `romjax.corrected` tells. After an impact of such a motion the model goes on from where the
    bodies are then.
    """
    training = training_of(system)
    if training is None:
        return run
    errors = _errors(training, simulate)
    # What most models pass is asked of every run, so it is asked in Python's numbers.
    passes = not any(one.hidden for one in errors) and all(
        one.error[-1] <= max(_MARGIN * _LEAST, _STEPS * one.rtol) for one in errors
    )
    rom = reduced_of(system) if has_fewer_freedoms(training) else None
    if passes and rom is None:
        return run
    tried: Any = np.zeros((), bool)
    tried = functools.reduce(operator.or_, [one.is_of(run, system) for one in errors], tried)
    told = 0 if passes else _by_training(system, run, rtol, errors, tried)
    if rom is not None:
        estimated = float(np.fmax(_TWICE * np.asarray(training_error(system)), 0))
        limit = _allowed(jnp if is_traced(rtol) else np, rtol, estimated / _ALLOWED)
        told |= flag_departure(rom, run, limit, tried, events)
    flags = concrete(run.flags)
    if is_traced(told) or flags is None:
        return dataclasses.replace(run, flags=run.flags | told)
    return dataclasses.replace(run, flags=as_jax(np.asarray(flags | told))) if told else run


def _by_training(
    system: AbstractSystem,
    run: Trajectory,
    rtol: Any,
    errors: tuple[TrainingError, ...],
    tried: Any,
) -> Any:
    """The flag that the errors of a model on its training tell."""
    span: Any = run.t[-1] - run.t[0]
    known, tolerance = concrete(span), concrete(rtol)
    tried = tried | _is_predictive(system)
    if known is None or tolerance is None or is_traced(tried):
        much, some = (
            jnp.max(jnp.stack([one.after(span) / limit(jnp, rtol, one.rtol) for one in errors])) > 1
            for limit in (_allowed, _promised)
        )
        told = jnp.where(some & ~tried, int(Flag.UNTRIED), 0)
        much |= max(one.missed for one in errors) > MUCH * RESOLVED * jnp.asarray(rtol)
        return jnp.where(much, int(Flag.LEFT_OUT), told)
    much, some = (
        max(one.after(known) / limit(np, tolerance, one.rtol) for one in errors) > 1
        for limit in (_allowed, _promised)
    )
    # A loose tolerance resolves no small motion of one body.
    much |= max(one.missed for one in errors) > MUCH * RESOLVED * tolerance
    return int(Flag.LEFT_OUT if much else Flag.UNTRIED if some and not tried else Flag.NONE)


def _is_predictive(system: AbstractSystem) -> bool:
    """Whether a model is of a kind that errs elsewhere as on its training."""
    training = training_of(system)
    recipe = None if training is None else training.recipe
    return recipe is not None and bool(recipe.formulation.is_predictive)


def _promised(xp: Any, rtol: Any, measured: float) -> Any:
    """The error on its training up to which a model is taken for right on other motions."""
    return xp.maximum(_MARGIN * _LEAST, _STEPS * xp.maximum(rtol, measured))


def _allowed(xp: Any, rtol: Any, measured: float) -> Any:
    """The error that a model may have in a run, where it was measured at a tolerance."""
    return xp.maximum(_ALLOWED * xp.maximum(rtol, measured), _LEAST)


def _errors(training: Training, simulate: Simulate) -> tuple[TrainingError, ...]:
    """The errors of a model, measured if nobody has."""
    if training.errors is None:
        outside_of_traces(lambda: _measure(training, simulate))
    return training.errors or ()


def _measure(training: Training, simulate: Simulate) -> None:
    """Fill in the errors of a model, which needs its motions no longer."""
    errors = []
    for number, motion in enumerate(training.motions):
        rom = _beginning_as(training.rom, motion, number == 0) if _is_known(motion) else None
        errors += [] if rom is None else [_error(rom, motion, simulate)]
    training.errors, training.motions = tuple(errors), ()


def _is_known(motion: Any) -> bool:
    """Whether a motion can be repeated: it is a run of a known system."""
    if not isinstance(motion, Trajectory) or motion.derived.parts is None:
        return False
    return motion.status.ndim == 0 and bool(motion.success) and undisturbed(motion) > 1


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


def _error(rom: AbstractReducedSystem, motion: Trajectory, simulate: Simulate) -> TrainingError:
    """Return the training error of a reduced model on one motion."""
    least = max(_SHARPEST, _DIGITS * float(np.finfo(motion.q.dtype).eps))
    given = _USUAL if motion.stats.rtol is None else float(motion.stats.rtol)
    rtol = max(given, least)
    run = simulate(rom, np.asarray(motion.t)[: undisturbed(motion)], rtol=rtol)
    q = np.asarray(motion.q)
    q = after_impacts(rom, motion, run, rtol, simulate) if run.success else q
    return error_of(motion, run, rtol, q)
