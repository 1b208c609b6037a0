"""Which model, method and tolerance give the accuracy one needs in the least time."""

import itertools
import time
from collections.abc import Sequence

import diffrax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from ...arrays import Vector
from ...assembly.assemble import assemble
from ...basis.rank import Rank
from ...errors import SimulationError
from ...integrate.rodas5p import Rodas5P
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from .measure import Way
from .models import DECOMPOSE, FORMULATIONS, default_kinds, reduced_models
from .reference import make_reference
from .result import ALONE, Accuracy, Condition, Model, with_front
from .search import Search, methods_for, promising, queue, rows_of

# What of a budget may be spent before the last program is compiled, since the runs are still to be
# timed; and before the last one for single runs in double precision, if there are others.
_COMPILING, _ALONE = 0.8, 0.55
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
    alone = _ALONE if len(conditions) > 1 else _COMPILING
    full = Model("full", "full", system)
    made = {full.name: full}
    look = "{desc:48} {n_fmt} runs, {elapsed}"
    with tqdm(disable=not progress, bar_format=look, desc="full model") as bar:
        search = Search(times, tolerances, steps, budget, begin, bar)
        chosen, *others = methods_for(full, methods, times)
        way = Way.of(full, chosen, times)
        training = way.run(min(tolerances))
        if not bool(training.success):
            raise SimulationError(
                f"accuracy: the full model by {training.solver_name} at rtol={min(tolerances):g} "
                f"has failed, {training.summary()}."
            )
        bar.set_description_str("reference")
        reference, words, floor = make_reference(way, training, min(tolerances))
        search.look(way, reference)
        try:
            kinds = default_kinds(system, training, formulations)
            if ranks is not None:
                kinds = list(itertools.product(formulations, ranks))
            models = reduced_models(
                system,
                training,
                way.clock(min(tolerances)),
                bases,
                kinds,
                search.skipped,
                lambda: search.spent(alone),
            )
            for model, method in queue(full, others, models, methods, times):
                made[model.name] = model
                search.attempt(model, method, reference, alone)
            for model, method in itertools.product(made.values(), methods if len(steps) else ()):
                search.attempt(model, method, reference, alone, fixed=True)
            for best, condition in itertools.product(promising(search.ways), conditions):
                if condition != ALONE:
                    more = (condition, best.fixed)
                    search.attempt(best.model, best.solver, reference, _COMPILING, *more)
            search.time(repeats)
        except KeyboardInterrupt:
            search.skipped["the rest"] = INTERRUPTED
    return Accuracy(
        with_front(rows_of(search.ways)),
        np.asarray(times),
        tuple(found.history for way in search.ways for found in way.found.values()),
        made,
        {type(method).__name__: method for method in methods},
        words,
        floor,
        search.skipped,
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
