"""Which model, method and tolerance give the accuracy one needs in the least time."""

import collections
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
from ...integrate.trajectory import SimulationError
from ...scene.fields import Vector
from ...scene.scene import Scene
from ...system.assemble import assemble
from ...system.base import AbstractSystem
from .measure import SLOW, Way
from .models import DECOMPOSE, FORMULATIONS, NO_TIME, default_kinds, reduced_models
from .reference import make_reference
from .result import ALONE, Accuracy, Condition, Model, Row, with_front

# What of a budget may be spent before the last program is compiled, since the runs are still to be
# timed; and before the last one for single runs in double precision, if there are others.
_COMPILING, _ALONE = 0.8, 0.55
# Tolerances below so many roundings are out of reach.
_ROUNDINGS = 10
PRECISIONS = ("f64", "f32")
INTERRUPTED = "interrupted"


def accuracy(
    what: Scene | AbstractSystem,
    ts: Vector,
    *,
    formulations: Sequence[str] = ("minimal", "galerkin"),
    bases: Sequence[str] = ("POD", "SOD"),
    ranks: Sequence[Rank] | None = None,
    solvers: Sequence[diffrax.AbstractSolver] | None = None,
    tolerances: Sequence[float] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    steps: Sequence[float] = (),
    precisions: Sequence[str] = ("f64", "f32"),
    lanes: Sequence[int] = (1, 256),
    repeats: int = 7,
    budget: int | float | None = None,
    progress: bool = False,
) -> Accuracy:
    """Error against time of full and reduced models, by method and tolerance.

    Errors are those of `Comparison.error` at the output times, against a reference of other
    equations (all minimal coordinates instead of redundant ones with constraints) that is at least
    ten thousand times tighter; the full model at the same tolerance says how far that is off. Times
    are those of compiled runs, interleaved. An interrupt (Ctrl-C) ends the study with what has been
    measured.

    **Arguments:**

    - `what`: a scene or a system, in double precision. `ts` (k,): output times [s].
    - `formulations`: of the reduced models, of "galerkin", "minimal", "projected". `bases`: "POD",
      "SOD". `ranks`: numbers of modes, or tolerances of them; unless given, all minimal coordinates
      and the drop point of the training run, and some less.
    - `solvers`: diffrax solvers; Rodas5P and Dopri8 unless given.
    - `tolerances`: of the step size control. `steps`: fixed steps [s] to try beside it.
    - `precisions`: "f64", and "f32" for single precision. `lanes`: how many runs at once, 1 and
      others. What is best alone and in double precision is tried under the other conditions too;
      lanes have tolerances that differ by up to a fifth, so that they take different steps.
    - `repeats`: how many times each is timed.
    - `budget`: time to spend [s]. The most promising ways are tried first; what there is no time
      for is listed as skipped.
    - `progress`: show a progress bar.

    Raises ValueError for a name or a number that makes no sense, SimulationError if the training
    run fails: the full model at the tightest tolerance.
    """
    _check(formulations, bases, tolerances, steps, precisions, lanes, repeats)
    begin = time.perf_counter()
    system = assemble(what) if isinstance(what, Scene) else what
    _check_precision(system)
    times = jnp.asarray(ts, system.q0.dtype)
    methods = [Rodas5P(), diffrax.Dopri8()] if solvers is None else list(solvers)
    conditions = [Condition(*pair) for pair in itertools.product(precisions, lanes)]
    full = Model("full", "full", system)
    made, ways = {full.name: full}, list[Way]()
    skipped: dict[str, str] = {}

    def spent(share: float) -> bool:
        return budget is not None and time.perf_counter() - begin > share * budget

    look = "{desc:48} {n_fmt} runs, {elapsed}"
    with tqdm(disable=not progress, bar_format=look, desc="full model") as bar:
        chosen, *others = _methods(full, methods, times)
        ways.append(Way.of(full, chosen, times))
        training = ways[0].run(min(tolerances))
        if not bool(training.success):
            raise SimulationError(
                f"accuracy: the full model by {training.solver} at rtol={min(tolerances):g} has "
                f"failed, {training.reason()}."
            )
        bar.set_description_str("reference")
        reference, words, floor = make_reference(ways[0], training, min(tolerances))

        def measure(way: Way, settings: Sequence[float]) -> None:
            for setting in settings:
                way.look(setting, reference)
                bar.update()

        def attempt(
            model: Model,
            method: diffrax.AbstractSolver,
            share: float,
            condition: Condition = ALONE,
            fixed: bool = False,
        ) -> None:
            name = _name(model, method, condition, fixed)
            if spent(share):
                skipped[name] = NO_TIME
                return
            bar.set_description_str(name)
            ways.append(Way.of(model, method, times, condition, fixed))
            least = _ROUNDINGS * np.finfo(np.float32).eps if condition.precision == "f32" else 0.0
            measure(ways[-1], steps if fixed else [rtol for rtol in tolerances if rtol >= least])

        try:
            measure(ways[0], tolerances)
            took = ways[0].clock(min(tolerances))
            kinds = default_kinds(system, training, formulations)
            if ranks is not None:
                kinds = list(itertools.product(formulations, ranks))
            alone = _ALONE if len(conditions) > 1 else _COMPILING
            models = reduced_models(
                system, training, took, bases, kinds, skipped, lambda: spent(alone)
            )
            for model, method in _queue(full, others, models, methods, times):
                made[model.name] = model
                attempt(model, method, alone)
            for model, method in itertools.product(made.values(), methods if len(steps) else ()):
                attempt(model, method, alone, fixed=True)
            best = _promising(ways)
            for way, condition in itertools.product(best, conditions):
                if condition != ALONE:
                    attempt(way.model, way.solver, _COMPILING, condition, way.fixed)
            bar.set_description_str("timing")
            _time(ways, repeats, lambda: spent(1.0), bar)
        except KeyboardInterrupt:
            if not ways[0].found:
                raise
            skipped["the rest"] = INTERRUPTED
    histories = tuple(found.history for way in ways for found in way.found.values())
    return Accuracy(
        with_front(_rows(ways)),
        np.asarray(times),
        histories,
        made,
        {type(method).__name__: method for method in methods},
        words,
        floor,
        skipped,
    )


def _check(
    formulations: Sequence[str],
    bases: Sequence[str],
    tolerances: Sequence[float],
    steps: Sequence[float],
    precisions: Sequence[str],
    lanes: Sequence[int],
    repeats: int,
) -> None:
    known = ((formulations, FORMULATIONS), (bases, tuple(DECOMPOSE)), (precisions, PRECISIONS))
    for given, names in known:
        for name in given:
            if name not in names:
                raise ValueError(f"accuracy: {name!r} is none of {', '.join(names)}.")
    if not len(tolerances) or not all(0 < rtol < 1 for rtol in tolerances) or repeats < 1:
        raise ValueError(
            f"accuracy: tolerances={tuple(tolerances)}, repeats={repeats}; give tolerances between "
            "0 and 1 and one repeat or more."
        )
    if not all(dt > 0 for dt in steps) or not all(count >= 1 for count in lanes):
        raise ValueError(
            f"accuracy: steps={tuple(steps)}, lanes={tuple(lanes)}; give steps longer than 0 s, "
            "and one lane or more."
        )


def _check_precision(system: AbstractSystem) -> None:
    if system.q0.dtype != jnp.float64:
        raise ValueError(
            "accuracy: the system is in single precision, which has no reference to measure errors "
            'against; call jax.config.update("jax_enable_x64", True) before making any array.'
        )


def _name(model: Model, method: diffrax.AbstractSolver, condition: Condition, fixed: bool) -> str:
    parts = [model.name, type(method).__name__]
    parts += ["fixed steps"] * fixed + ["f32"] * (condition.precision == "f32")
    parts += [f"{condition.lanes} lanes"] * (condition.lanes > 1)
    return ", ".join(parts)


def _rows(ways: Iterable[Way]) -> list[Row]:
    return [row for way in ways for row in way.rows()]


def _promising(ways: list[Way]) -> list[Way]:
    """Those on the front, and on that of the full model alone, by turns; most of it first."""
    fronts = []
    for own in (ways, [way for way in ways if way.model.formulation == "full"]):
        owners = [way for way in own for _ in way.found]
        rows = zip(owners, with_front(_rows(own)), strict=True)
        counts = collections.Counter(way for way, row in rows if row.pareto)
        fronts.append([way for way, _ in counts.most_common()])
    turns = itertools.chain.from_iterable(itertools.zip_longest(*fronts))
    return list(dict.fromkeys(way for way in turns if way))


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


def _time(ways: list[Way], repeats: int, late: Callable[[], bool], bar: tqdm) -> None:
    """Rounds of all runs, until there are enough or the time is up; the first look was one."""
    for _ in range(repeats - 1):
        for way in ways:
            for setting, times in way.times.items():
                if late():
                    return
                if times and times[-1] * way.condition.lanes < SLOW:
                    times.append(way.clock(setting))
            bar.update(0)
