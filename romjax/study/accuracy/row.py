"""Measurements of one configuration at one tolerance or step, and the best of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

# The name of the model that is not reduced.
FULL = "full"


class Condition(NamedTuple):
    """The condition under which runs were made; each has a work–precision diagram."""

    precision: str  # "f64", "f32"
    lanes: int  # that run at once


SINGLE_RUN = Condition("f64", 1)


class Row(NamedTuple):
    """One model, simulated by one method at one tolerance, or in steps of one length."""

    model: str
    formulation: str  # its name, or "full"
    rank: int
    solver: str
    rtol: float  # NaN in fixed steps
    dt: float  # [s] NaN with step size control
    precision: str
    lanes: int
    error: float  # as `Comparison.error`, of the worst lane; NaN where a run failed
    least: float  # [s] of the interleaved runs, or until it failed; of one lane of several
    median: float  # [s]
    compile: float  # [s] or to read the program from disk
    offline: float  # [s] to make the model, from the training run on
    steps: int
    evaluations: int  # of the right-hand side
    factorizations: int  # of the Jacobian
    memory: int  # [B] of the compiled run
    failure: str  # why it failed; empty if it did not
    pareto: bool  # nothing else under its condition is as accurate in less time

    @property
    def condition(self) -> Condition:
        """The precision and the number of lanes."""
        return Condition(self.precision, self.lanes)

    @property
    def is_full(self) -> bool:
        """Whether it is of the full model."""
        return self.model == FULL

    @property
    def set_up(self) -> float:
        """The time until the first run starts [s]: to make the model, and to compile it."""
        return self.offline + self.compile

    @property
    def first(self) -> float:
        """The time until the first answer is there [s]."""
        return self.set_up + self.lanes * self.least

    @property
    def settings(self) -> dict[str, float]:
        """The tolerance or the step, for `simulate`."""
        return {"rtol": self.rtol} if np.isnan(self.dt) else {"dt": self.dt}


def with_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """The rows, each with `pareto` set if it lies on the Pareto front of its condition."""
    front, best = set(), dict[Condition, float]()
    for row in sorted((r for r in rows if not r.failure), key=lambda r: (r.least, r.error)):
        if row.error < best.get(row.condition, np.inf):
            best[row.condition] = row.error
            front.add((row.condition, row.least, row.error))
    return tuple(
        row._replace(pareto=(row.condition, row.least, row.error) in front) for row in rows
    )
