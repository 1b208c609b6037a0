"""The search for models that pay, within a time."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ..assembly.assemble import assemble
from ..assembly.assembled import AssembledSystem
from ..common.arrays import as_array
from ..common.errors import InputError, ReductionError
from ..common.plain import duration
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..scene.scene import Scene
from ..study.timing import worked
from .attempt import Attempt, Settings, Truth, attempt, error, made, named, simulated
from .candidates import Candidate, Family, families
from .clock import Clock
from .facts import Facts, beginning
from .progress import Progress
from .variants import TRAINING, UNSEEN, Change, variants

NO_TIME = "no time left in the budget"
GAINED = "a model is ten times as fast already"
# So many times as fast is a gain that other kinds add little to: so many more are tried. Time would
# be no measure of how many, since another run finds the programs of the first, and tries others.
_GAIN, _MORE = 10.0, 3
# The tolerance of the runs that errors are measured against, relative to that of the models; and
# the least that double precision allows.
_SHARPER, _SHARPEST = 1e-2, 1e-12
# [s] If a run takes longer, those from other starts have the tolerance of the models; and if the
# full model takes longer to compile, its energy is not audited, which is a program more.
_LONG, _LONG_TO_COMPILE = 1.0, 10.0
# A run from another start that takes so many times as many steps follows vibrations of its own.
_MOST_STEPS = 5
# A run that differs from the first by less than so many times the error that models may have shows
# nothing that the first does not.
_DIFFERENT = 3.0
# The most models and refusals of one kind, and the most models where nothing is stiff: there, more
# of one kind would show the same as the first ones.
_MOST, _MOST_REFUSED, _MOST_QUICK = 5, 3, 2
# The most models to try between one that is right and one that is wrong.
_BETWEEN = 2
# A model that fails or is refused counts as one that errs by so many times too much.
_FAILED = 10.0
# So does one that is right but for a body's deflection, which is little beside the motion.
_HIDING = 10.0
# A model whose error on unseen starts is so many times that on its training needs more training.
_REPEATS = 5.0
# A kind is given up if its model errs too much and takes so many times as long as the full one,
# since finer ones take longer still. Ranks that are tried one by one go down: they may get faster.
_SLOW, _SLOW_RANK = 0.8, 3.0


@dataclasses.dataclass
class Try:
    """The state of the search in one kind of models.

    It has the next candidate, None where there is none, and the number of its training runs; how
    many models and refusals there were; the coarsest that is right in all its parts, and the finest
    that is wrong in one.
    """

    family: Family
    candidate: Candidate | None
    runs: int = 1
    models: int = 0
    refused: int = 0
    right: tuple[Candidate, Attempt] | None = None
    wrong: Candidate | None = None

    @classmethod
    def of(cls, family: Family) -> "Try":
        """The first candidate of a kind."""
        return cls(family, family.candidates[0])

    @property
    def is_compiled(self) -> bool:
        """Whether the programs of another model of this kind are compiled already."""
        return self.models > 0 and not self.family.compiles

    def next(self, excess: float) -> None:
        """Go on to a model that may do where the last one errs by `excess` times what is asked."""
        assert self.candidate is not None
        excess = excess if np.isfinite(excess) else _FAILED
        self.candidate = self.family.finer(self.candidate, excess)


@dataclasses.dataclass
class Search:
    """A mechanism with its accurate runs, and the models that were tried; `full`: its run at the
    tolerance of the models, the work on it `once`, and `compiled` [s] to compile; `progress`: what
    is told meanwhile.
    """

    scene: Scene
    system: AssembledSystem
    ts: Float[Array, " k"]
    settings: Settings
    progress: Progress
    full: Trajectory
    once: float
    compiled: float
    training: list[Truth]
    facts: Facts
    unseen: list[Truth] = dataclasses.field(default_factory=list)
    attempts: list[Attempt] = dataclasses.field(default_factory=list)
    refused: dict[str, str] = dataclasses.field(default_factory=dict)
    skipped: dict[str, str] = dataclasses.field(default_factory=dict)

    @classmethod
    def begun(cls, scene: Scene, ts: Any, settings: Settings, progress: Progress) -> "Search":
        """Begin with the full model's runs from the start of the scene.

        Raises SimulationError if they fail.
        """
        system = assemble(scene)
        times = as_array(ts).astype(system.q0.dtype)
        facts = Facts.of(scene, system)
        kinds = ", ".join(family.name for family in families(facts))
        progress.tell(facts.describe())
        progress.tell(f"models to try, in some order: {kinds}")
        rtol, solver = settings.rtol, settings.solver
        # Long before the first run has compiled; it needs them too.
        progress.tell(f"full: {beginning(system, times, solver)} ...")
        progress.doing("full model")

        def call() -> Trajectory:
            return simulate(system, times, rtol=rtol, solver=solver, audit=False)

        full, first = worked(call)
        _, once = worked(call)
        steps = f"{_steps(full)} steps, {duration(once)}"
        progress.tell(f"full: {system.n} coordinates, {steps}")
        progress.doing("accurate run")
        truth = Truth.of(system, full, _sharp(rtol))
        return cls(
            scene=scene,
            system=system,
            ts=times,
            settings=settings,
            progress=progress,
            full=full,
            once=once,
            compiled=max(0.0, first - once),
            training=[truth or Truth(system, full, once)],
            facts=facts.after(full),
        )

    def own(self) -> tuple[float, float]:
        """The errors of the full model on the training and unseen, NaN where runs take long."""
        method, beyond = (self.settings.rtol, self.full.solver), list[float]()
        if self.once < _LONG:
            runs = [simulated(truth.system, self.ts, *method) for truth in self.unseen]
            beyond = [error(x.run, run) for x, run in zip(self.unseen, runs, strict=True)]
        return error(self.training[0].run, self.full), max(beyond, default=np.nan)

    def audit(self) -> None:
        """Draw up the balance of energy of the full model's run and of the accurate one, which stay
        the same motions, unless it compiles for long.
        """
        if self.compiled >= _LONG_TO_COMPILE:
            return
        self.progress.doing("balance of energy")
        rough, truth, rtol = self.full, self.training[0], self.settings.rtol
        self.full = simulated(self.system, self.ts, rtol, rough.solver, audit=True)
        run = self.full  # of both where the accurate one failed
        if truth.run is not rough:
            run = simulated(self.system, self.ts, _sharp(rtol), rough.solver, audit=True)
        self.training[0] = truth._replace(run=run)

    def try_all(self, spend: float) -> None:
        """Try kinds of models, the most promising first, each until it is right or hopeless, while
        the processor's time is within what there is to spend [s]; then coarser ones of those that
        are far too accurate, without compiling where one gains. None where nothing moves.
        """
        if self.facts.rests:
            return
        self.unseen = self.truths(UNSEEN)
        clock = Clock(spend)
        tries = [Try.of(family) for family in families(self.facts)]
        more = _MORE
        for number, one in enumerate(tries):
            if self.gains:
                if not more:
                    self.leave(tries[number:], GAINED)
                    break
                more -= 1
            while one.candidate is not None:
                # At least one model is tried, whatever the time.
                if self.attempts and not clock.has_time(one.is_compiled):
                    self.leave(tries[number:], NO_TIME)
                    return
                with clock:
                    self.step(one)
        gains, right = self.gains, [(x.right[1].work, x) for x in tries if x.right is not None]
        for _, one in sorted(right, key=lambda pair: pair[0]):
            if not gains or one.is_compiled:
                self.coarsen(one, clock)
            else:
                self.skipped[f"coarser {one.family.name}"] = GAINED

    @property
    def gains(self) -> bool:
        """Whether a model is right, in all its parts, and far faster than the full one."""
        tol = self.settings.tol
        right = [one.work for one in self.attempts if one.error <= tol and not one.hidden]
        return self.once >= _GAIN * min(right, default=np.inf)

    def leave(self, tries: Sequence[Try], why: str) -> None:
        """Name the kinds that are not tried, and the one that was being refined."""
        names = [one.family.name for one in tries if not (one.models or one.refused)]
        names += [f"finer {one.family.name}" for one in tries if one.models and one.candidate]
        self.skipped.update(dict.fromkeys(names, why))

    def coarsen(self, one: Try, clock: Clock) -> None:
        """Try models between the coarsest of a kind that is right and the finest that is wrong."""
        for _ in range(_BETWEEN):
            assert one.right is not None
            candidate, tried = one.right
            excess = tried.error / self.settings.tol
            one.candidate = one.family.coarser(candidate, excess, one.wrong)
            if one.candidate is None or not clock.has_time(one.is_compiled):
                return
            count = len(self.attempts)
            with clock:
                self.step(one)
            if len(self.attempts) == count:  # as many modes as one of both
                return

    def step(self, one: Try) -> None:
        """Try the next candidate of a kind."""
        family, candidate = one.family, one.candidate
        assert candidate is not None
        self.progress.doing(family.name)
        if one.runs > len(self.training):
            self.training += self.truths(TRAINING)
        training = self.training[: one.runs]
        try:
            model, making = made(self.system, candidate, training)
            if named(model, len(training)) in [tried.name for tried in self.attempts]:
                one.next(_FAILED)
                return
            tried = attempt(model, making, training, self.unseen, self.once, self.settings)
        except (InputError, ReductionError) as refusal:
            one.refused += 1
            if not one.models:
                self.refused[family.name] = str(refusal)
            one.next(_FAILED)
            if one.refused == _MOST_REFUSED:
                one.candidate = None
            return
        self.refused.pop(family.name, None)
        one.models += 1
        self.attempts.append(tried)
        self.progress.tell(tried.describe(self.once), models=1)
        self.judge(one, tried)

    def judge(self, one: Try, tried: Attempt) -> None:
        """Say what to try next of a kind."""
        candidate, excess = one.candidate, tried.error / self.settings.tol
        assert candidate is not None
        slow = _SLOW_RANK if one.family.scale is None else _SLOW
        repeats = tried.unseen > max(self.settings.tol, _REPEATS * tried.trained)
        most = _MOST_QUICK if self.facts.quick else _MOST
        if excess <= 1 and not tried.hidden:
            one.right, one.candidate = (candidate, tried), None
            return
        one.wrong = candidate
        if tried.work > slow * self.once or one.models >= most:
            one.candidate = None
        elif one.family.trained and one.runs == 1 and repeats:
            one.runs = 1 + len(TRAINING)
        else:
            one.next(max(excess, _HIDING) if tried.hidden else excess)

    def truths(self, changes: Sequence[Change]) -> list[Truth]:
        """Accurate runs of other starts or speeds, of those that can be simulated."""
        self.progress.doing("other starts or speeds")
        first, rtol = self.training[0].run, self.settings.rtol
        like, rtol = (self.full, rtol) if self.once > _LONG else (first, _sharp(rtol))
        least, truths = _DIFFERENT * self.settings.tol, list[Truth]()
        for change in changes:
            for system in variants(self.scene, self.system, first, change):
                truth = Truth.of(system, like, rtol, max_steps=_MOST_STEPS * _steps(like))
                if truth is not None and error(first, truth.run) > least:
                    truths.append(truth)
                    break
        return truths


def _sharp(rtol: float) -> float:
    return max(_SHARPER * rtol, _SHARPEST)


def _steps(run: Trajectory) -> int:
    return int(run.stats.num_steps)
