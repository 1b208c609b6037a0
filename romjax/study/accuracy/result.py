"""The result of a study of accuracy and time."""

import dataclasses
from typing import Any

import diffrax
import numpy as np

from ...common.errors import InputError
from ...common.extras import data_frame
from ...common.plain import duration
from .model import Model
from .recommendation import Recommendation
from .row import SINGLE_RUN, Condition, Row

# Errors this many times that of the reference are a run's own.
_ABOVE = 30


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """Error and time of every configuration that was tried; made by `accuracy`.

    - `rows`: one for each model, method and tolerance, under each condition.
    - `times` (k,): output times [s]. `histories`, a (k,) for each row: the error at each of them,
      ‖M₀^½ (q̃ − q)(t)‖ over the largest ‖M₀^½ (q − q₀)‖.
    - `reference`: what errors are measured against, in words; `floor`: its own error, NaN where it
      could not be checked.
    - `skipped`: configurations that the time budget left no room for, and models that were refused,
      by name, with the reason.
    """

    rows: tuple[Row, ...]
    times: np.ndarray
    histories: tuple[np.ndarray, ...]
    models: dict[str, Model]
    solvers: dict[str, diffrax.AbstractSolver[Any]]
    reference: str
    floor: float
    skipped: dict[str, str]

    def table(self) -> Any:
        """All rows as a pandas data frame, sorted by error (extra `study`)."""
        return data_frame("Accuracy.table", self.rows, "the rows are in .rows").sort_values(
            "error", ignore_index=True
        )

    @property
    def conditions(self) -> list[Condition]:
        """The conditions under which something was measured."""
        return list(dict.fromkeys(row.condition for row in self.rows))

    @property
    def lanes(self) -> list[int]:
        """How many runs at once were tried, in double precision."""
        precision = SINGLE_RUN.precision
        return [c.lanes for c in self.conditions if c.precision == precision]

    def front(self, condition: Condition = SINGLE_RUN) -> list[Row]:
        """The Pareto front, from the fastest to the most accurate."""
        best = [row for row in self.rows if row.pareto and row.condition == condition]
        return sorted(best, key=lambda row: row.least)

    def recommend(self, error: float, *, lanes: int = 1) -> Recommendation:
        """The cheapest configuration with an `error` in double precision, in words and as
        arguments of `simulate`; for many runs at once if `lanes` is their number in the study.

        Raises InputError if nothing is as accurate, naming the best.
        """
        front = self.front(Condition(SINGLE_RUN.precision, lanes))
        if not front:
            tried = ", ".join(f"{count}" for count in self.lanes)
            raise InputError(f"recommend: nothing was measured with lanes={lanes}, only {tried}.")
        good = [row for row in front if row.error <= error]
        if not good:
            best = front[-1]
            raise InputError(
                f"recommend: nothing that was tried has an error of {error:g}; the best is "
                f"{best.error:.1e}, by {best.model} with {best.solver}. Study tighter tolerances, "
                "or higher ranks."
            )
        row = good[0]
        (name, setting), each = *row.settings.items(), f" a run, {lanes} at once" * (lanes > 1)
        words = (
            f"For an error of {error:g}: {row.model}, solver={row.solver}(), {name}={setting:.0e}; "
            f"error {row.error:.1e} in {duration(row.least)}{each}."
        )
        runs = self.break_even(row)
        if runs is not None:
            when = f"after {runs:,.0f} runs" if np.isfinite(runs) else "never"
            words += f" Making the model pays for itself {when}."
        settings = {"solver": self.solvers[row.solver], **row.settings}
        return Recommendation(error, row, self.models[row.model], settings, words)

    def break_even(self, row: Row) -> float | None:
        """Return the number of runs after which a reduced model has paid for itself.

        That is the time to make and to compile it over T_full − T_reduced, where the full model
        runs as cheaply as it can at the same error.
        The full model is compiled in any case, for the training run.

        None for the full model, and where that was not measured at this error; infinite where
        nothing is saved.
        """
        full = self.cheapest_full(row)
        if row.is_full or full is None:
            return None
        if full.least <= row.least:
            return np.inf
        return row.set_up / (full.least - row.least)

    def cheapest_full(self, row: Row) -> Row | None:
        """The full model's cheapest run at the error of `row`, under the same condition."""
        own = [r for r in self.rows if r.is_full and r.condition == row.condition]
        good = [r for r in own if r.error <= row.error]
        return min(good, key=lambda r: r.least, default=None)

    def order(self, model: str, solver: str) -> float:
        """The observed order of a method in fixed steps: the slope of the logarithms of error and
        step, by least squares, of runs with errors well above that of the reference.

        Raises InputError if there are fewer than two such runs.
        """
        least = _ABOVE * np.nan_to_num(self.floor)
        rows = [
            r for r in self.rows if (r.model, r.solver, r.condition) == (model, solver, SINGLE_RUN)
        ]
        rows = [r for r in rows if r.dt > 0 and r.error > least]
        if len(rows) < 2:
            raise InputError(
                f"order: {model!r} by {solver!r} has {len(rows)} runs in fixed steps with errors "
                f"above {least:.0e}, which give no slope; study two or more `steps`."
            )
        slope, _ = np.polyfit(np.log([r.dt for r in rows]), np.log([r.error for r in rows]), 1)
        return float(slope)
