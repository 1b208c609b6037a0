"""The gain of reduction for a mechanism: the models that its structure suggests, tried."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import diffrax
import jax.numpy as jnp

from ..common.arrays import Vector
from ..common.checks import check_kind
from ..common.errors import InputError, ReductionError
from ..integrate.settings import check_times
from ..integrate.trajectory import Trajectory
from ..scene.scene import Scene
from ..study.errors.corrected import corrected
from ..study.timing import alternating
from ..system.base import AbstractSystem
from .advice import advice, in_order, paying, remark
from .attempt import Attempt, Settings, error, simulated
from .progress import Progress
from .result import Reductions
from .row import ReductionRow
from .search import NO_TIME, Search

INTERRUPTED = "interrupted"
# Shares of the budget for trying models and for timing them.
_TRYING, _TIMING = 0.8, 0.15


def reductions(
    scene: Scene,
    ts: Vector,
    *,
    tol: float = 1e-3,
    rtol: float = 1e-8,
    solver: diffrax.AbstractSolver[Any] | None = None,
    budget: float = 60.0,
    progress: bool = False,
) -> Reductions:
    """Find the reduced models of a scene that pay, tested on starts that they have not seen.

    By the structure of the mechanism (drives, loops, flexible bodies, freedoms, plane or space)
    kinds of models are chosen, coarse ones first, and refined until they are accurate; what only
    repeats its training is trained with three runs. Errors are measured on the training, and on
    three runs that no model has seen: at other speeds of drives and loads, else from other starts.
    All models run by the method that suits them, at one tolerance, and are timed in turns with the
    full one, on a CPU by the time of the processor, so that what else the machine does changes
    little. They are without the audit of energy, which the two runs of the full model from the
    start of the scene have, where that takes less than 10 s to compile.

    **Arguments:**

    - `scene`: the mechanism. `ts` (k,): output times [s].
    - `tol`: the error that a model may have, as `Comparison.error`.
    - `rtol`: tolerance of all runs; those that errors are measured against have a hundredth.
    - `solver`: of all runs; for each the one that suits it unless given.
    - `budget`: time of a processor to spend on models [s], about, besides that of the full one, so
      that a busy machine tries as many; the most promising come first, and what there was no time
      for is named. Once a model is right and ten times as fast, three more kinds are tried, and
      coarser models only if they compile nothing.
    - `progress`: tell of each model as soon as it was tried, in a terminal with a progress bar.
      Ctrl-C ends the study with what has been measured.

    Raises InputError for numbers without meaning, SimulationError if the full model fails.
    """
    check_kind("reductions", "the first argument", scene, Scene, "a romjax.Scene")
    if not (0 < tol < 1 and 0 < rtol < 1 and budget > 0):
        raise InputError(
            f"reductions: tol={tol}, rtol={rtol}, budget={budget}; both tolerances must lie "
            "between 0 and 1, and there must be time to spend."
        )
    times = check_times("reductions", ts, jnp.result_type(float))
    with Progress(progress) as told:
        search = Search.begun(scene, times, Settings(tol, rtol, solver), told)
        try:
            search.try_all(_TRYING * budget)
            search.audit()
        except KeyboardInterrupt:
            search.skipped["the rest"] = INTERRUPTED
        told.doing("times")
        return _result(search, _TIMING * budget)


def _result(search: Search, spend: float) -> Reductions:
    """Return what was found, with all models timed in turns for `spend` [s]."""
    systems: list[AbstractSystem] = [
        search.system,
        *(tried.model.system for tried in search.attempts),
    ]
    tol, rtol, solver = search.settings

    def call(system: AbstractSystem) -> Callable[[], Trajectory]:
        return lambda: simulated(system, search.ts, rtol, solver)

    calls = [call(system) for system in systems]
    timed = alternating(calls, spend)
    full_time, (trained, unseen) = float(timed.times[0]), search.own()
    said = search.full.each_warning()
    full = ReductionRow(
        name="full",
        formulation="full",
        rank=search.system.n,
        runs=0,
        steps=int(search.full.stats.num_steps),
        time=full_time,
        speed_up=1.0,
        trained=trained,
        unseen=unseen,
        made=0.0,
        compiled=search.compiled,
        pays_after=float("nan"),
        remark=remark(trained, unseen, max(trained, unseen), said) or "; ".join(said),
    )
    rows = [
        _row(tried, float(taken), float(ratio), full)
        for tried, taken, ratio in zip(
            search.attempts, timed.times[1:], timed.speed_ups[1:], strict=True
        )
    ]
    order = in_order(rows, tol)
    costs = [row.made + row.compiled for row in rows]
    untried = _untried(search.skipped, costs, spend / _TIMING)
    picked: Sequence[Attempt] = [search.attempts[rows.index(row)] for row in order]
    return Reductions(
        rows=tuple(order),
        models=tuple(tried.model.system for tried in picked),
        runs=tuple(tried.run for tried in picked),
        tol=tol,
        full=full,
        system=search.system,
        truth=search.training[0].run,
        advice=advice(rows, full, search.facts, tol, untried, bool(search.unseen)),
        refused=search.refused,
        skipped=search.skipped,
        pays=bool(paying(rows, tol)),
        unseen=len(search.unseen),
        bar=_bar(picked[0], search) if paying(rows, tol) else "",
    )


def _untried(skipped: Mapping[str, str], costs: Sequence[float], budget: float) -> str:
    """Say what may pay, for all that is known, and how to try it; `costs` of the models so far, and
    the `budget` [s] that was too small.
    """
    if INTERRUPTED in skipped.values():
        return "the study was interrupted"
    left = [name for name, why in skipped.items() if why == NO_TIME]
    if not left:
        return ""
    count = sum(not name.startswith("finer ") for name in left)
    which = {0: "finer ones were", 1: "one kind was"}.get(count, f"{count} kinds were")
    # Each is taken to cost as much as one so far, of which some may have come from the disk; in
    # tens.
    enough = sum(costs) * (1 + len(left) / max(1, len(costs))) / _TRYING
    tens = math.ceil(max(enough, 2 * budget) / 10)
    return f"{which} not tried for lack of time; give a larger `--budget`, such as {10 * tens}"


def _bar(tried: Attempt, search: Search) -> str:
    """Return the error of a model that a user sees where no truth is known, beside the truth."""
    if not search.unseen:
        return ""
    truth, (_, rtol, solver) = search.unseen[0], search.settings
    try:
        model = tried.model.of(truth.system, truth.run.t[0])
        run = simulated(model, search.ts, rtol, solver)
        told = corrected(model, run)
    except (InputError, ReductionError):  # of such runs nothing is known to tell
        return ""
    assert told.bar is not None
    return (
        f"romjax.corrected says of {tried.name} on the first unseen run: {told.bar.describe()}; "
        f"its error is {error(truth.run, run):.1e}."
    )


def _row(tried: Attempt, taken: float, ratio: float, full: ReductionRow) -> ReductionRow:
    cost = tried.made + tried.compiled
    return ReductionRow(
        name=tried.name,
        formulation=tried.model.formulation,
        rank=tried.model.rank,
        runs=tried.runs,
        steps=int(tried.run.stats.num_steps),
        time=taken,
        speed_up=ratio,
        trained=tried.trained,
        unseen=tried.unseen,
        made=tried.made,
        compiled=tried.compiled,
        pays_after=cost / (full.time - taken) if ratio > 1 and full.time > taken else float("inf"),
        remark=remark(
            tried.trained, tried.unseen, full.error, tried.run.each_warning(), tried.hidden
        ),
        hidden=tried.hidden,
    )
