"""What a study of accuracy and time has found."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import diffrax
import numpy as np

from ...arrays import Vector
from ...basis.basis import Basis
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.system import ReducedSystem
from ...system.base import AbstractSystem
from ..variation import begin, vary


@dataclasses.dataclass(frozen=True)
class Model:
    """A system to simulate: the full one, or a reduced one and what it was made of."""

    name: str
    formulation: str  # "full", "galerkin", "minimal", "projected"
    system: AbstractSystem
    basis: Basis | None = None
    offline: float = 0.0  # [s] to simulate the training run, decompose it and reduce

    @property
    def rank(self) -> int:
        return self.system.n

    def of(self, system: AbstractSystem) -> AbstractSystem:
        """The same model of a system with other numbers."""
        if self.basis is None or not isinstance(self.system, ReducedSystem):
            return system
        return vary(self.system, self.basis, system)


class Condition(NamedTuple):
    """Under which runs were made: one work–precision diagram for each."""

    precision: str  # "f64", "f32"
    lanes: int  # that run at once


ALONE = Condition("f64", 1)

# Errors this many times that of the reference are a run's own.
_ABOVE = 30


class Row(NamedTuple):
    """One model, simulated by one method at one tolerance, or in steps of one length."""

    model: str
    formulation: str
    rank: int
    solver: str
    rtol: float  # NaN in fixed steps
    dt: float  # [s] NaN with step size control
    precision: str
    lanes: int
    error: float  # as `Comparison.error`, of the worst lane; NaN where a run failed
    least: float  # [s] of the interleaved runs, or until it failed; of one lane of several
    median: float  # [s]
    compile: float  # [s]
    offline: float  # [s]
    steps: int
    evaluations: int  # of the right-hand side
    factorizations: int  # of the Jacobian
    memory: int  # [B] of the compiled run
    failure: str  # why it failed; empty if it did not
    pareto: bool  # nothing else under its condition is as accurate in less time

    @property
    def condition(self) -> Condition:
        return Condition(self.precision, self.lanes)

    @property
    def settings(self) -> dict[str, float]:
        """The tolerance or the step, for `simulate`."""
        return {"rtol": self.rtol} if np.isnan(self.dt) else {"dt": self.dt}


@dataclasses.dataclass(frozen=True)
class Recommendation:
    """The cheapest way to an `error`: `words`, and `settings` for `simulate`.

    `simulate(system, ts)` does it, of the system that was studied or one with other numbers.
    """

    error: float
    row: Row
    model: Model
    settings: dict[str, Any]
    words: str

    def simulate(self, system: AbstractSystem, ts: Vector, **more: Any) -> Trajectory:
        """A run of `system` as recommended; a reduced model's says in `warnings()` if it left what
        it was trained on.
        """
        model = self.model.of(system)
        start = {}
        if isinstance(model, ReducedSystem):
            q0, v0 = begin(model, system.q0, system.v0, np.asarray(ts)[0])
            start = {"q0": q0, "v0": v0}
        return simulate(model, ts, **{**start, **self.settings, **more})

    def __str__(self) -> str:
        return self.words


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """Error and time of every way that was tried; made by `accuracy`.

    - `rows`: one for each model, method and tolerance, under each condition.
    - `times` (k,): output times [s]. `histories`, a (k,) for each row: the error at each of them,
      ‖M₀^½ (q̃ − q)(t)‖ over the largest ‖M₀^½ (q − q₀)‖.
    - `reference`: what errors are measured against, in words; `floor`: its own error, NaN where it
      could not be checked.
    - `skipped`: ways that the time budget left no room for, and models that were refused, by name,
      with the reason.
    """

    rows: tuple[Row, ...]
    times: np.ndarray
    histories: tuple[np.ndarray, ...]
    models: dict[str, Model]
    solvers: dict[str, diffrax.AbstractSolver]
    reference: str
    floor: float
    skipped: dict[str, str]

    def table(self) -> Any:
        """All rows as a pandas data frame, sorted by error (extra `study`)."""
        try:
            import pandas
        except ImportError as error:
            raise ImportError(
                "Accuracy.table needs pandas: pip install 'romjax[study]'; the rows are in .rows."
            ) from error
        return pandas.DataFrame(self.rows).sort_values("error", ignore_index=True)

    @property
    def conditions(self) -> list[Condition]:
        """Those under which something was measured."""
        return list(dict.fromkeys(row.condition for row in self.rows))

    def front(self, condition: Condition = ALONE) -> list[Row]:
        """The Pareto front, from the fastest to the most accurate."""
        own = [row for row in self.rows if row.pareto and row.condition == condition]
        return sorted(own, key=lambda row: row.least)

    def recommend(self, error: float, *, lanes: int = 1) -> Recommendation:
        """The cheapest way to an `error` in double precision, in words and as arguments of
        `simulate`; for many runs at once if `lanes` is their number in the study.

        Raises ValueError if no way is as accurate, naming the best one.
        """
        front = self.front(Condition(ALONE.precision, lanes))
        if not front:
            known = ", ".join(f"{c.lanes}" for c in self.conditions if c.precision == "f64")
            raise ValueError(f"recommend: nothing was measured with lanes={lanes}, only {known}.")
        good = [row for row in front if row.error <= error]
        if not good:
            best = front[-1]
            raise ValueError(
                f"recommend: nothing that was tried has an error of {error:g}; the best is "
                f"{best.error:.1e}, by {best.model} with {best.solver}. Study tighter tolerances, "
                "or higher ranks."
            )
        row = good[0]
        (name, setting), each = *row.settings.items(), f" a run, {lanes} at once" * (lanes > 1)
        words = (
            f"For an error of {error:g}: {row.model}, solver={row.solver}(), {name}={setting:.0e}; "
            f"error {row.error:.1e} in {1e3 * row.least:.2g} ms{each}."
        )
        runs = self.break_even(row)
        if runs is not None:
            when = f"after {runs:,.0f} runs" if np.isfinite(runs) else "never"
            words += f" Making the model pays for itself {when}."
        settings = {"solver": self.solvers[row.solver], **row.settings}
        return Recommendation(error, row, self.models[row.model], settings, words)

    def break_even(self, row: Row) -> float | None:
        """After how many runs a reduced model has saved what it took to make: T_offline over
        T_full − T_reduced, where the full model takes the cheapest way to the same error.

        None for the full model, and where that was not measured at this error; infinite where
        nothing is saved.
        """
        full = self.cheapest_full(row)
        if row.formulation == "full" or full is None:
            return None
        if full.least <= row.least:
            return np.inf
        return row.offline / (full.least - row.least)

    def cheapest_full(self, row: Row) -> Row | None:
        """The full model's cheapest way to the error of `row`, under the same condition."""
        own = [r for r in self.rows if (r.model, r.condition) == ("full", row.condition)]
        good = [r for r in own if r.error <= row.error]
        return min(good, key=lambda r: r.least, default=None)

    def order(self, model: str, solver: str) -> float:
        """The observed order of a method in fixed steps: the slope of the logarithms of error and
        step, by least squares, of runs with errors well above that of the reference.

        Raises ValueError if there are fewer than two such runs.
        """
        least = _ABOVE * np.nan_to_num(self.floor)
        rows = [r for r in self.rows if (r.model, r.solver, r.condition) == (model, solver, ALONE)]
        rows = [r for r in rows if r.dt > 0 and r.error > least]
        if len(rows) < 2:
            raise ValueError(
                f"order: {model!r} by {solver!r} has {len(rows)} runs in fixed steps with errors "
                f"above {least:.0e}, which give no slope; study two or more `steps`."
            )
        slope, _ = np.polyfit(np.log([r.dt for r in rows]), np.log([r.error for r in rows]), 1)
        return float(slope)


def with_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """The rows, each knowing whether it lies on the Pareto front of its condition."""
    front, best = set(), dict[Condition, float]()
    for row in sorted((r for r in rows if not r.failure), key=lambda r: (r.least, r.error)):
        if row.error < best.get(row.condition, np.inf):
            best[row.condition] = row.error
            front.add((row.condition, row.least, row.error))
    return tuple(
        row._replace(pareto=(row.condition, row.least, row.error) in front) for row in rows
    )
