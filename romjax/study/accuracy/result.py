"""What a study of accuracy and time has found."""

import dataclasses
from typing import Any, NamedTuple

import diffrax
import numpy as np

from ...basis.basis import Basis
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...scene.fields import Vector
from ...system.base import AbstractSystem
from ...system.reduced.base import AbstractReducedSystem
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
        if self.basis is None or not isinstance(self.system, AbstractReducedSystem):
            return system
        return vary(self.system, self.basis, system)


class Row(NamedTuple):
    """One model, simulated by one method at one tolerance."""

    model: str
    formulation: str
    rank: int
    solver: str
    rtol: float
    error: float  # as `Comparison.error`; NaN where the run failed
    least: float  # [s] of the interleaved runs
    median: float  # [s]
    compile: float  # [s]
    offline: float  # [s]
    steps: int
    evaluations: int  # of the right-hand side
    factorizations: int  # of the Jacobian
    memory: int  # [B] of the compiled run
    failure: str  # why it failed; empty if it did not
    pareto: bool  # nothing else is as accurate in less time


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
        """A run of `system` as recommended; a reduced model's says in `doubts()` if it left what
        it was trained on.
        """
        model = self.model.of(system)
        start = {}
        if isinstance(model, AbstractReducedSystem):
            q0, v0 = begin(model, system.q0, system.v0, np.asarray(ts)[0])
            start = {"q0": q0, "v0": v0}
        return simulate(model, ts, **{**start, **self.settings, **more})

    def __str__(self) -> str:
        return self.words


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """Error and time of every way that was tried; made by `accuracy`.

    - `rows`: one for each model, method and tolerance.
    - `reference`: what errors are measured against, in words; `floor`: its own error, NaN where it
      could not be checked.
    - `skipped`: ways that the time budget left no room for, and models that were refused, by name,
      with the reason.
    """

    rows: tuple[Row, ...]
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

    def front(self) -> list[Row]:
        """The Pareto front, from the fastest to the most accurate."""
        return sorted((row for row in self.rows if row.pareto), key=lambda row: row.least)

    def recommend(self, error: float) -> Recommendation:
        """The cheapest way to an `error`, in words and as arguments of `simulate`.

        Raises ValueError if no way is as accurate, naming the best one.
        """
        good = [row for row in self.front() if row.error <= error]
        if not good:
            best = min(self.rows, key=lambda row: np.nan_to_num(row.error, nan=np.inf))
            raise ValueError(
                f"recommend: nothing that was tried has an error of {error:g}; the best is "
                f"{best.error:.1e}, by {best.model} with {best.solver}. Study tighter tolerances, "
                "or higher ranks."
            )
        row = good[0]
        solver = self.solvers[row.solver]
        words = (
            f"For an error of {error:g}: {row.model}, solver={row.solver}(), rtol={row.rtol:.0e}; "
            f"error {row.error:.1e} in {1e3 * row.least:.2g} ms."
        )
        saved = self.break_even(row)
        if saved is not None:
            words += f" Making the model pays for itself after {saved:,.0f} runs."
        model = self.models[row.model]
        return Recommendation(error, row, model, {"solver": solver, "rtol": row.rtol}, words)

    def break_even(self, row: Row) -> float | None:
        """After how many runs a reduced model has saved what it took to make: T_offline over
        T_full − T_reduced, where the full model takes the cheapest way to the same error.

        None for the full model; infinite where nothing is saved.
        """
        if row.formulation == "full":
            return None
        full = [r for r in self.rows if r.formulation == "full" and r.error <= row.error]
        least = min((r.least for r in full), default=np.inf)
        return row.offline / (least - row.least) if least > row.least else np.inf


def with_front(rows: list[Row]) -> tuple[Row, ...]:
    """The rows, each knowing whether it lies on the Pareto front."""
    good = sorted((row.least, row.error) for row in rows if not row.failure)
    front, best = set(), np.inf
    for least, error in good:
        if error < best:
            front.add((least, error))
            best = error
    return tuple(row._replace(pareto=(row.least, row.error) in front) for row in rows)
