"""Which model, method and tolerance give the accuracy one needs in the least time."""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from ...basis.rank import Rank
from ...integrate.default import default_solver, frequencies
from ...integrate.rodas5p import Rodas5P
from ...integrate.simulate import simulate
from ...integrate.trajectory import SimulationError, Trajectory
from ...scene.fields import Vector
from ...scene.scene import Scene
from ...system.assemble import assemble
from ...system.base import AbstractSystem
from ...system.reduced.base import ReductionError
from ...system.stabilization import Projection
from ..compare import compare
from .measure import Way
from .models import DECOMPOSE, FORMULATIONS, NO_TIME, complete, default_kinds, reduced_models
from .result import Accuracy, Model, with_front

# The reference is so many times tighter than the tightest run; and what of a budget may be spent
# before the last program is compiled, since the runs are still to be timed.
_TIGHTER, _COMPILING = 1e-4, 0.8
# [s] What takes longer is timed once.
_SLOW = 2.0


def accuracy(
    what: Scene | AbstractSystem,
    ts: Vector,
    *,
    formulations: Sequence[str] = ("minimal", "galerkin"),
    bases: Sequence[str] = ("POD", "SOD"),
    ranks: Sequence[Rank] | None = None,
    solvers: Sequence[diffrax.AbstractSolver] | None = None,
    tolerances: Sequence[float] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    repeats: int = 7,
    budget: float | None = None,
    progress: bool = False,
) -> Accuracy:
    """Error against time of full and reduced models, by method and tolerance.

    Errors are those of `Comparison.error` at the output times, against a reference of other
    equations (all minimal coordinates instead of redundant ones with constraints) that is at least
    ten thousand times tighter; the full model at the same tolerance says how far that is off. Times
    are those of compiled runs, interleaved.

    **Arguments:**

    - `what`: a scene or a system. `ts` (k,): output times [s].
    - `formulations`: of the reduced models, of "galerkin", "minimal", "projected". `bases`: "POD",
      "SOD". `ranks`: numbers of modes, or tolerances of them; unless given, all minimal coordinates
      and the drop point of the training run, and some less.
    - `solvers`: diffrax solvers; Rodas5P and Dopri8 unless given.
    - `tolerances`: of the step size control.
    - `repeats`: how many times each is timed.
    - `budget`: time to spend [s]. The most promising ways are tried first; what there is no time
      for is listed as skipped.
    - `progress`: show a progress bar.

    Raises ValueError for a name or a number that makes no sense, SimulationError if the training
    run fails: the full model at the tightest tolerance.
    """
    _check(formulations, bases, tolerances, repeats)
    begin = time.perf_counter()
    system = assemble(what) if isinstance(what, Scene) else what
    times = jnp.asarray(ts, system.q0.dtype)
    methods = [Rodas5P(), diffrax.Dopri8()] if solvers is None else list(solvers)
    tightest = min(tolerances)
    full = Model("full", "full", system)
    made, ways = {full.name: full}, list[Way]()
    skipped: dict[str, str] = {}

    def left() -> float:
        spent = time.perf_counter() - begin
        return np.inf if budget is None else budget - spent

    def enough() -> bool:
        return budget is not None and left() < (1 - _COMPILING) * budget

    look = "{desc:36} {n_fmt} runs, {elapsed}"
    with tqdm(disable=not progress, bar_format=look, desc="full model") as bar:
        chosen, *others = _methods(full, methods, times)
        ways.append(Way.of(full, chosen, times))
        training = ways[0].run(tightest)
        if not bool(training.success):
            raise SimulationError(
                f"accuracy: the full model by {training.solver} at rtol={tightest:g} has failed, "
                f"{training.reason()}."
            )
        bar.set_description_str("reference")
        reference, words, floor = _reference(ways[0], training, max(_TIGHTER * tightest, 1e-13))
        kinds = default_kinds(system, training, formulations)
        if ranks is not None:
            kinds = list(itertools.product(formulations, ranks))
        took = ways[0].clock(tightest)
        models = reduced_models(system, training, took, bases, kinds, skipped, enough)
        for model, method in _queue(full, others, models, methods, times):
            made[model.name] = model
            name = f"{model.name}, {type(method).__name__}"
            if enough():
                skipped[name] = NO_TIME
                continue
            bar.set_description_str(name)
            ways.append(Way.of(model, method, times))
        for way, rtol in itertools.product(ways, tolerances):
            bar.set_description_str(f"{way.model.name}, {way.solver}")
            way.look(rtol, reference)
            bar.update()
        bar.set_description_str("timing")
        _time(ways, repeats, left, bar)
    rows = with_front([row for way in ways for row in way.rows()])
    kept = {type(method).__name__: method for method in methods}
    return Accuracy(rows, made, kept, words, floor, skipped)


def _check(
    formulations: Sequence[str], bases: Sequence[str], tolerances: Sequence[float], repeats: int
) -> None:
    for given, known in ((formulations, FORMULATIONS), (bases, tuple(DECOMPOSE))):
        for name in given:
            if name not in known:
                raise ValueError(f"accuracy: {name!r} is none of {', '.join(known)}.")
    if not len(tolerances) or not all(0 < rtol < 1 for rtol in tolerances) or repeats < 1:
        raise ValueError(
            f"accuracy: tolerances={tuple(tolerances)}, repeats={repeats}; give tolerances between "
            "0 and 1 and one repeat or more."
        )


def _reference(way: Way, training: Trajectory, rtol: float) -> tuple[Trajectory, str, float]:
    """A motion to measure errors against, what it is, and its own error."""
    second = way.run(rtol)
    words = f"at rtol={rtol:.0e}, checked by redundant ones with {way.solver}"
    if not bool(second.success):
        words = f"at rtol={rtol:.0e}, unchecked, as {way.solver} failed there ({second.reason()})"
    settings = {"rtol": rtol, "adjoint": diffrax.ForwardMode(), "max_steps": 1_000_000}
    system, solver = way.model.system, diffrax.Dopri8()
    try:
        first = simulate(complete(training, system), training.t, solver=solver, **settings)
        words = f"minimal coordinates by Dopri8 {words}"
    except (ReductionError, SimulationError):
        keep = Projection()
        first = simulate(system, training.t, solver=solver, stabilization=keep, **settings)
        words = f"redundant coordinates with projection by Dopri8 {words}"
    floor = float(compare(first, second).error) if bool(second.success) else np.nan
    return first, words, floor


def _methods(
    model: Model, methods: Sequence[diffrax.AbstractSolver], ts: Any
) -> list[diffrax.AbstractSolver]:
    """The methods, with that first which `simulate` would choose."""
    system = model.system
    found = frequencies(system, ts, system.q0, system.v0)
    chosen = type(default_solver(system, ts, None, found))
    return sorted(methods, key=lambda method: type(method) is not chosen)


def _queue(
    full: Model,
    others: Sequence[diffrax.AbstractSolver],
    models: Iterable[Model],
    methods: Sequence[diffrax.AbstractSolver],
    ts: Any,
) -> Iterator[tuple[Model, diffrax.AbstractSolver]]:
    """Each model by the method that `simulate` would choose, then by the others; the full model
    among the first, for all else is measured by it.
    """
    later = [(full, method) for method in others]
    for model in models:
        own, *rest = _methods(model, methods, ts)
        yield model, own
        later += [(model, method) for method in rest]
        if later and later[0][0] is full:
            yield later.pop(0)
    yield from later


def _time(ways: list[Way], repeats: int, left: Callable[[], float], bar: tqdm) -> None:
    """Rounds of all runs, until there are enough or the time is up."""
    for turn in range(repeats):
        for way in ways:
            for rtol, (_, _, failure) in way.found.items():
                slow = way.times[rtol] and way.times[rtol][-1] > _SLOW
                if failure or slow or (turn and left() < 0):
                    continue
                way.times[rtol].append(way.clock(rtol))
        bar.update(0)
