"""One candidate: made, run from all starts, and judged."""

import dataclasses
import warnings
from typing import Any, NamedTuple

import diffrax
import numpy as np
from jaxtyping import Array, Float

from ..assembly.assembled import AssembledSystem
from ..basis.decomposition.pod import POD
from ..common.errors import InputError, ReductionError
from ..common.plain import duration
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..reduction.reduce import reduce
from ..study.accuracy.model import Model, Reduction
from ..study.compare import compare
from ..study.timing import worked
from ..system.base import AbstractSystem, check_reducible
from .candidates import Candidate

# [s] If the runs from unseen starts take longer, only models that may pay are tried on them.
_LONG = 1.0


class Settings(NamedTuple):
    """The error `tol` that models may have, and the settings of all runs.

    `solver`: for each model the method that suits it unless given.
    """

    tol: float
    rtol: float
    solver: diffrax.AbstractSolver[Any] | None


class Truth(NamedTuple):
    """A system with an accurate run of it, and the `work` [s] of the processor on that."""

    system: AbstractSystem
    run: Trajectory
    work: float

    @classmethod
    def of(
        cls, system: AbstractSystem, like: Trajectory, rtol: float, **limits: int
    ) -> "Truth | None":
        """A run by the method of another one, unless it fails, beyond its `limits` too."""
        try:
            run, work = worked(
                lambda: simulated(system, like.t, rtol, like.solver, False, **limits)
            )
        except InputError:  # no start
            return None
        return cls(system, run, work) if bool(run.success) else None


@dataclasses.dataclass(frozen=True)
class Attempt:
    """A model with its run from the start of the scene.

    - `runs`: how many it was trained with. `made`, `compiled`, `work` [s]: of the processor, to
      train and make it, to compile, and on one run.
    - `trained`, `unseen`: the largest errors of the runs that it was made of, and of others;
      `hidden`: what these errors hide, in words, "" where nothing.
    """

    name: str
    model: Model
    run: Trajectory
    runs: int
    made: float
    compiled: float
    work: float
    trained: float
    unseen: float
    hidden: str

    @property
    def error(self) -> float:
        """The larger one."""
        return max(self.trained, 0.0 if np.isnan(self.unseen) else self.unseen)

    def describe(self, full: float) -> str:
        """A line on the model, beside the `full` one's work on a run [s]."""
        beyond = "" if np.isnan(self.unseen) else f", unseen {self.unseen:.0e}"
        return (
            f"{self.name}: {int(self.run.stats.num_steps)} steps, {duration(self.work)}, "
            f"{full / self.work:.1f} times as fast, error {self.trained:.0e}{beyond}"
        )


def simulated(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    rtol: float,
    solver: diffrax.AbstractSolver[Any] | None = None,
    audit: bool = False,
    **limits: int,
) -> Trajectory:
    """A run, by the method that suits the system unless one is given, within `limits` such as
    `max_steps`; what speaks against it goes to the table. Without the balance of energy unless
    `audit`, which is a program more: errors are measured.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        settings: dict[str, Any] = {"throw": False, "audit": audit, **limits}
        return simulate(system, ts, rtol=rtol, solver=solver, **settings)


def made(full: AssembledSystem, candidate: Candidate, training: list[Truth]) -> tuple[Model, float]:
    """The model of a candidate, and the work that it took [s].

    Raises ReductionError, RankError or InputError where there is none.
    """

    def make() -> Model:
        if candidate.cap is not None:
            model = Model(full, cap=candidate.cap)
            assert model.system.n == full.n  # it is made when it is first asked for
            return model
        assert candidate.formulation is not None
        check_reducible(full, candidate.formulation)
        runs = [truth.run for truth in training]
        if candidate.decomposition is None:
            exact = reduce(full, None, candidate.formulation)
            return Model(full, Reduction(exact, POD(1)(runs), candidate.formulation, 0.0))
        basis = candidate.formulation.basis(full, runs, candidate.decomposition)
        # All formulations make such systems, but for those that serve as a reference only. `reduce`
        # says which other formulation would do; here the table does.
        rom = candidate.formulation.reduce(full, basis)
        return Model(full, Reduction(rom, basis, candidate.formulation, 0.0))

    return worked(make)


def named(model: Model, runs: int) -> str:
    """Return the name of a model in tables."""
    if model.cap is not None:
        return model.name.replace(",", "")
    of = "" if runs == 1 else f", {runs} runs"
    return f"{model.formulation} r={model.rank}{of}"


def attempt(
    model: Model,
    making: float,
    training: list[Truth],
    unseen: list[Truth],
    full: float,
    settings: Settings,
) -> Attempt:
    """The model run and judged; `full`: the work of a run of the full one [s]."""
    first, *others = training
    method = settings.rtol, settings.solver
    run, with_compiling = worked(lambda: simulated(model.system, first.run.t, *method))
    # The second run, since the first compiles: what it takes more is the price of compiling.
    _, work = worked(lambda: simulated(model.system, first.run.t, *method))
    known = [judged(first.run, run), *(judgement_of(model, x, settings) for x in others)]
    trained = max(one.error for one in known)
    # Long runs are not worth their time for a model that is wrong on its training, or slow.
    paying = trained <= settings.tol and work < full
    if not paying and len(unseen) * work > _LONG:
        unseen = []
    # A cap needs no training; all other models need its full runs.
    needs = 0.0 if model.cap is not None else sum(truth.work for truth in training)
    beyond = [judgement_of(model, truth, settings) for truth in unseen]
    return Attempt(
        name=named(model, len(training)),
        model=model,
        run=run,
        runs=0 if model.cap is not None else len(training),
        made=making + needs,
        compiled=max(0.0, with_compiling - work),
        work=work,
        trained=trained,
        unseen=max((one.error for one in beyond), default=np.nan),
        hidden=next((one.hidden for one in [*beyond, *known] if one.hidden), ""),
    )


class Judgement(NamedTuple):
    """The error of a run, and what it hides in words; see `Comparison.hidden`."""

    error: float
    hidden: str


def judgement_of(model: Model, truth: Truth, settings: Settings) -> Judgement:
    """The judgement of a run of another system; infinite where the model cannot start or fails."""
    try:
        other = model.of(truth.system, truth.run.t[0])
        return judged(truth.run, simulated(other, truth.run.t, settings.rtol, settings.solver))
    except (ReductionError, InputError):
        return Judgement(np.inf, "")


def judged(truth: Trajectory, run: Trajectory) -> Judgement:
    """The error of a run, infinite if it has failed, and what it hides."""
    comparison = compare(truth, run)
    value = float(comparison.error)
    failed = not np.isfinite(value) or not bool(run.success)
    return Judgement(np.inf, "") if failed else Judgement(value, comparison.hidden())


def error(truth: Trajectory, run: Trajectory) -> float:
    """Return the error of a run, infinite if it has failed."""
    return judged(truth, run).error
