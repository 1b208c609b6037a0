"""A study of accuracy from its training run to its result."""

import itertools
from typing import Any

import diffrax
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

from ...common.errors import SimulationError
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from .configuration import Configuration
from .model import Model
from .models import default_caps, default_choices, reduced_models
from .order import methods_for, promising, queue
from .reference import make_reference
from .result import Accuracy
from .row import SINGLE_RUN, with_front
from .search import Search, rows_of
from .settings import Settings

# What of a budget may be spent before the last program is compiled, since the runs are still to be
# timed; and before the last one for single runs in double precision, if there are others.
_COMPILING, _SINGLE_RUNS = 0.8, 0.55
INTERRUPTED = "interrupted"


def run_study(
    system: AbstractSystem,
    times: Float[Array, " k"],
    settings: Settings,
    begin: float,
    bar: tqdm,  # type: ignore[type-arg]  # generic in the stubs only
) -> Accuracy:
    """Try what the `settings` ask for; `begin` [s]: since when the budget is spent.

    Raises SimulationError if the full model fails at the tightest tolerance.
    """
    full = Model(system)
    chosen, *others = methods_for(full, settings.solvers, times)
    first = Configuration.compiled(full, chosen, times)
    training = _train(first, min(settings.tolerances))
    bar.set_description_str("reference")
    reference = make_reference(first, training, min(settings.tolerances))
    search = Search(settings, times, reference.motion, begin, bar)
    search.evaluate(first)
    models = {full.name: full}
    try:
        _try_single_runs(search, training, others, models)
        _try_other_conditions(search)
        search.time_all()
    except KeyboardInterrupt:
        search.skipped["the rest"] = INTERRUPTED
    outcomes = [one for tried in search.configurations for one in tried.outcomes.values()]
    return Accuracy(
        with_front(rows_of(search.configurations)),
        np.asarray(times),
        tuple(outcome.history for outcome in outcomes),
        models,
        {type(method).__name__: method for method in settings.solvers},
        reference.words,
        reference.floor,
        search.skipped,
    )


def _train(full: Configuration, rtol: float) -> Trajectory:
    """The run that reduced models are made of."""
    training = full.run(rtol)
    if not bool(training.success):
        raise SimulationError(
            f"accuracy: the full model by {full.method} at rtol={rtol:g} has failed, "
            f"{training.summary()}."
        )
    return training


def _try_single_runs(
    search: Search,
    training: Trajectory,
    others: list[diffrax.AbstractSolver[Any]],
    models: dict[str, Model],
) -> None:
    """All models by all methods, one run at a time in double precision; adds to `models`.

    `others`: methods that the full model was not tried by yet.
    """
    settings, (first,) = search.settings, search.configurations
    full, times = first.model, search.times
    share = _SINGLE_RUNS if len(settings.conditions) > 1 else _COMPILING
    choices = default_choices(full.system, training, settings.formulations)
    if settings.ranks is not None:
        choices = list(itertools.product(settings.formulations, settings.ranks))
    caps = default_caps(full.system) if settings.caps is None else settings.caps
    slower = [Model(full.system, cap=hertz) for hertz in caps]
    candidates = reduced_models(
        full.system,
        training,
        first.time_run(min(settings.tolerances)),
        settings.decompositions,
        choices,
        search.skipped,
        lambda: search.spent(share),
    )
    every = itertools.chain(slower, candidates)
    for model, method in queue(full, others, every, settings.solvers, times):
        models[model.name] = model
        search.attempt(model, method, share)
    if len(settings.steps):
        for model, method in itertools.product(models.values(), settings.solvers):
            search.attempt(model, method, share, fixed=True)


def _try_other_conditions(search: Search) -> None:
    """Try the best configurations of single runs in single precision and several at once."""
    best = promising(search.configurations)
    for one, condition in itertools.product(best, search.settings.conditions):
        if condition != SINGLE_RUN:
            search.attempt(one.model, one.solver, _COMPILING, condition, one.fixed)
