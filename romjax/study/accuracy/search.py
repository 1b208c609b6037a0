"""Which ways a study of accuracy tries first, and how far it gets in the time it has."""

import collections
import dataclasses
import itertools
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import diffrax
import numpy as np
from tqdm import tqdm

from ...integrate.default import default_solver, start_frequencies
from ...integrate.trajectory import Trajectory
from .measure import SLOW, Way
from .models import NO_TIME
from .result import ALONE, Condition, Model, Row, with_front

# Tolerances below so many roundings are out of reach.
_ROUNDINGS = 10


@dataclasses.dataclass
class Search:
    """The ways that were tried, and those that there was no time for."""

    times: Any  # (k,) [s] of the outputs
    tolerances: Sequence[float]
    steps: Sequence[float]  # [s] fixed ones
    budget: float | None  # [s]
    begin: float  # [s] when it was
    bar: tqdm
    ways: list[Way] = dataclasses.field(default_factory=list)
    skipped: dict[str, str] = dataclasses.field(default_factory=dict)

    def spent(self, share: float) -> bool:
        """Whether this share of the budget is gone."""
        return self.budget is not None and time.perf_counter() - self.begin > share * self.budget

    def attempt(
        self,
        model: Model,
        method: diffrax.AbstractSolver,
        reference: Trajectory,
        share: float,
        condition: Condition = ALONE,
        fixed: bool = False,
    ) -> None:
        """Compile a way and look at its runs, unless the share of the budget is gone."""
        name = _name(model, method, condition, fixed)
        if self.spent(share):
            self.skipped[name] = NO_TIME
            return
        self.bar.set_description_str(name)
        self.look(Way.of(model, method, self.times, condition, fixed), reference)

    def look(self, way: Way, reference: Trajectory) -> None:
        """One run at each tolerance that is in reach, or step."""
        self.ways.append(way)
        single = way.condition.precision == "f32"
        least = _ROUNDINGS * np.finfo(np.float32).eps if single else 0.0
        for setting in self.steps if way.fixed else self.tolerances:
            if way.fixed or setting >= least:
                way.look(setting, reference)
                self.bar.update()

    def time(self, repeats: int) -> None:
        """Rounds of all runs, until there are enough or the time is up; the look was the first."""
        self.bar.set_description_str("timing")
        for _ in range(repeats - 1):
            for way in self.ways:
                for setting, times in way.times.items():
                    if self.spent(1.0):
                        return
                    slow = times[-1] * way.condition.lanes > SLOW
                    if not slow and not way.found[setting].failure:
                        times.append(way.clock(setting))
                self.bar.update(0)


def rows_of(ways: Iterable[Way]) -> list[Row]:
    """What was found, without a front."""
    return [row for way in ways for row in way.rows()]


def promising(ways: list[Way]) -> list[Way]:
    """Those on the front, and on that of the full model alone, by turns; what has most digits of it
    first.
    """
    fronts = []
    for own in (ways, [way for way in ways if way.model.formulation == "full"]):
        owners, digits = [way for way in own for _ in way.found], collections.Counter[Way]()
        for way, row in zip(owners, with_front(rows_of(own)), strict=True):
            if row.pareto:
                digits[way] -= np.log10(max(row.error, np.finfo(float).tiny))
        fronts.append([way for way, _ in digits.most_common()])
    turns = itertools.chain.from_iterable(itertools.zip_longest(*fronts))
    return list(dict.fromkeys(way for way in turns if way))


def methods_for(
    model: Model, methods: Sequence[diffrax.AbstractSolver], ts: Any
) -> list[diffrax.AbstractSolver]:
    """The methods, with that first which `simulate` would choose."""
    system = model.system
    found = start_frequencies(system, ts, system.q0, system.v0)
    chosen = type(default_solver(system, ts, None, found))
    return sorted(methods, key=lambda method: type(method) is not chosen)


def queue(
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
        own, *rest = methods_for(model, methods, ts)
        yield model, own
        later += [(model, method) for method in rest]
        if later and later[0][0] is full:
            yield later.pop(0)
    yield from later


def _name(model: Model, method: diffrax.AbstractSolver, condition: Condition, fixed: bool) -> str:
    parts = [model.name, type(method).__name__]
    parts += ["fixed steps"] * fixed + ["f32"] * (condition.precision == "f32")
    parts += [f"{condition.lanes} lanes"] * (condition.lanes > 1)
    return ", ".join(parts)
