"""The search for models that pay, within a time."""

import dataclasses
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ..assembly.assemble import assemble
from ..assembly.assembled import AssembledSystem
from ..common.arrays import as_array
from ..common.errors import InputError, ReductionError
from ..integrate.rodas5p import Rodas5P
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..scene.scene import Scene
from ..study.timing import timed
from .attempt import Attempt, Settings, Truth, attempt, error, made, named, simulated
from .candidates import Family, families
from .facts import Facts
from .variants import TRAINING, UNSEEN, Change, variants

NO_TIME = "no time left in the budget"
# Errors are measured against runs that are sharper by this factor, as far as numbers allow.
_SHARPER, _SHARPEST = 1e-2, 1e-12
# [s] Of other starts, runs that take longer have the tolerance of the models.
_LONG = 1.0
# Models of one kind at most, and the share of `tol` below which a finer one is not asked for.
_MOST, _ENOUGH = 4, 0.05
# Where nothing is stiff, the second model of a kind would say what the first one did.
_MOST_QUICK = 2
# A model that errs by so many times more where it was not trained needs more runs.
_REPEATS = 5.0
# A kind is given up where its model takes so many times as long as the full one.
_SLOW = 1.5


@dataclasses.dataclass
class Try:
    """How far a kind of models has come: the number of the next candidate, and of training runs."""

    family: Family
    candidate: int = 0
    runs: int = 1
    models: int = 0
    done: bool = False


@dataclasses.dataclass
class Search:
    """A mechanism with its accurate runs, and the models that were tried.

    - `full`: its run at the tolerance of the models, which takes `once` [s] and `compiled` [s] to
      compile.
    - `bar`: of progress.
    """

    scene: Scene
    system: AssembledSystem
    ts: Float[Array, " k"]
    settings: Settings
    bar: Any
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
    def begun(cls, scene: Scene, ts: Any, settings: Settings, bar: Any) -> "Search":
        """With the full model's runs from the start of the scene; raises SimulationError if they
        fail.
        """
        system = assemble(scene)
        times = as_array(ts).astype(system.q0.dtype)
        bar.set_description_str("full model")
        rtol, solver = settings.rtol, settings.solver
        full, first = timed(lambda: simulate(system, times, rtol=rtol, solver=solver))
        _, once = timed(lambda: simulate(system, times, rtol=rtol, solver=solver))
        _tell(bar, f"full: {system.n} coordinates, {_steps(full)} steps in {1e3 * once:.1f} ms")
        truth = _truth(system, full, _sharp(rtol))
        facts = Facts.of(scene, system, full, isinstance(full.solver, Rodas5P))
        return cls(
            scene=scene,
            system=system,
            ts=times,
            settings=settings,
            bar=bar,
            full=full,
            once=once,
            compiled=max(0.0, first - once),
            training=[truth or Truth(system, full, once)],
            facts=facts,
        )

    def own(self) -> tuple[float, float]:
        """The errors of the full model on the training and unseen, NaN where runs take long."""
        method, beyond = (self.settings.rtol, self.full.solver), list[float]()
        if self.once < _LONG:
            runs = [simulated(truth.system, self.ts, *method, audit=True) for truth in self.unseen]
            beyond = [error(x.run, run) for x, run in zip(self.unseen, runs, strict=True)]
        return error(self.training[0].run, self.full), max(beyond, default=np.nan)

    def try_all(self, deadline: float) -> None:
        """Try kinds of models in turns, the most promising first, until the processor's time comes
        to the deadline [s].
        """
        self.unseen = self.truths(UNSEEN)
        tries, taken = [Try(family) for family in families(self.facts)], [0.0]
        while open_ones := [one for one in tries if not one.done]:
            for one in open_ones:
                begin = time.process_time()
                # One model at least.
                if self.attempts and begin + np.mean(taken) > deadline:
                    names = [one.family.name for one in tries if not (one.models or one.candidate)]
                    self.skipped.update(dict.fromkeys(names, NO_TIME))
                    return
                self.step(one)
                taken.append(time.process_time() - begin)

    def step(self, one: Try) -> None:
        """Try the next candidate of a kind."""
        family = one.family
        self.bar.set_description_str(family.name)
        if one.runs > len(self.training):
            self.training += self.truths(TRAINING)
        training = self.training[: one.runs]
        try:
            model, making = made(self.system, family.candidates[one.candidate], training)
            if named(model, len(training)) in [tried.name for tried in self.attempts]:
                _finer(one)
                return
            tried = attempt(model, making, training, self.unseen, self.settings)
        except (InputError, ReductionError) as refusal:
            if not one.models:
                self.refused[family.name] = str(refusal)
            _finer(one)
            return
        self.refused.pop(family.name, None)
        one.models += 1
        self.attempts.append(tried)
        self.bar.update()
        _tell(self.bar, _line(tried, self.once))
        self.judge(one, tried)

    def judge(self, one: Try, tried: Attempt) -> None:
        """Say what to try next of a kind."""
        slower = tried.once / self.once
        enough = tried.error <= _ENOUGH * self.settings.tol
        too_slow = slower > (_SLOW if tried.error <= self.settings.tol else 2 * _SLOW)
        repeats = tried.unseen > max(self.settings.tol, _REPEATS * tried.trained)
        most = _MOST_QUICK if self.facts.quick else _MOST
        if enough or too_slow or one.models == most:
            one.done = True
        elif one.family.trained and one.runs == 1 and repeats:
            one.runs = 1 + len(TRAINING)
        else:
            _finer(one)

    def truths(self, changes: Sequence[Change]) -> list[Truth]:
        """Accurate runs of other starts or speeds, of those that can be simulated."""
        self.bar.set_description_str("other starts" if not self.facts.drives else "other speeds")
        systems = variants(self.scene, self.system, self.training[0].run, changes)
        rtol = self.settings.rtol if self.once > _LONG else _sharp(self.settings.rtol)
        found = [_truth(system, self.full, rtol) for system in systems]
        return [truth for truth in found if truth is not None]


def _tell(bar: Any, words: str) -> None:
    """A line that stays above the bar, if there is one."""
    if not bar.disable:
        bar.write(words, file=sys.stderr)


def _finer(one: Try) -> None:
    one.candidate += 1
    one.done = one.candidate == len(one.family.candidates)


def _truth(system: AssembledSystem, like: Trajectory, rtol: float) -> Truth | None:
    """A run by the method of another one, unless it fails."""
    try:
        run, taken = timed(lambda: simulated(system, like.t, rtol, like.solver, audit=True))
    except InputError:  # no start
        return None
    return Truth(system, run, taken) if bool(run.success) else None


def _sharp(rtol: float) -> float:
    return max(_SHARPER * rtol, _SHARPEST)


def _steps(run: Trajectory) -> int:
    return int(run.stats.num_steps)


def _line(tried: Attempt, full: float) -> str:
    """What is known of a model as soon as it was tried."""
    beyond = "" if np.isnan(tried.unseen) else f", unseen {tried.unseen:.1e}"
    return (
        f"{tried.name}: {_steps(tried.run)} steps in {1e3 * tried.once:.1f} ms, "
        f"{full / tried.once:.1f} times as fast, error {tried.trained:.1e}{beyond}"
    )
