"""How far a study of accuracy gets in the time it has: what is compiled, run and timed."""

import dataclasses
import time
from collections.abc import Iterable
from typing import Any

import diffrax
import numpy as np
from tqdm import tqdm

from ...integrate.trajectory import Trajectory
from .configuration import SLOW, Configuration
from .model import Model
from .models import NO_TIME
from .row import SINGLE_RUN, Condition, Row
from .settings import Settings

# Tolerances below so many roundings are out of reach.
_ROUNDINGS = 10


@dataclasses.dataclass
class Search:
    """The configurations that were tried, and those that there was no time for."""

    settings: Settings
    times: Any  # (k,) [s] of the outputs
    reference: Trajectory
    begin: float  # [s] when it was
    bar: tqdm  # type: ignore[type-arg]  # generic in the stubs only
    configurations: list[Configuration] = dataclasses.field(default_factory=list)
    skipped: dict[str, str] = dataclasses.field(default_factory=dict)

    def spent(self, share: float) -> bool:
        """Whether this share of the budget is gone."""
        budget = self.settings.budget
        return budget is not None and time.perf_counter() - self.begin > share * budget

    def attempt(
        self,
        model: Model,
        method: diffrax.AbstractSolver[Any],
        share: float,
        condition: Condition = SINGLE_RUN,
        fixed: bool = False,
    ) -> None:
        """Compile a configuration and evaluate it, unless the share of the budget is gone."""
        name = _name(model, method, condition, fixed)
        if self.spent(share):
            self.skipped[name] = NO_TIME
            return
        self.bar.set_description_str(name)
        self.evaluate(Configuration.compiled(model, method, self.times, condition, fixed))

    def evaluate(self, configuration: Configuration) -> None:
        """One run at each tolerance that is in reach, or step."""
        self.configurations.append(configuration)
        single = configuration.condition.precision == "f32"
        least = _ROUNDINGS * np.finfo(np.float32).eps if single else 0.0
        fixed = configuration.fixed
        for setting in self.settings.steps if fixed else self.settings.tolerances:
            if fixed or setting >= least:
                configuration.evaluate(setting, self.reference)
                self.bar.update()

    def time_all(self) -> None:
        """Rounds of all runs, until there are enough or the time is up.

        Evaluation was the first round. Runs that failed or are slow are timed no more.
        """
        self.bar.set_description_str("timing")
        for _ in range(self.settings.repeats - 1):
            for configuration in self.configurations:
                lanes = configuration.condition.lanes
                for setting, times in configuration.times.items():
                    if self.spent(1.0):
                        return
                    slow = times[-1] * lanes > SLOW
                    if not slow and not configuration.outcomes[setting].failure:
                        times.append(configuration.time_run(setting))
                self.bar.update(0)


def rows_of(configurations: Iterable[Configuration]) -> list[Row]:
    """Return the measured rows, without a front."""
    return [row for configuration in configurations for row in configuration.rows()]


def _name(
    model: Model, method: diffrax.AbstractSolver[Any], condition: Condition, fixed: bool
) -> str:
    parts = [model.name, type(method).__name__]
    parts += ["fixed steps"] * fixed + ["f32"] * (condition.precision == "f32")
    parts += [f"{condition.lanes} lanes"] * (condition.lanes > 1)
    return ", ".join(parts)
