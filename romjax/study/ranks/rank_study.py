"""Study of ranks: error on the training and beyond it, against steps and time."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import diffrax
import numpy as np
from tqdm import tqdm

from ...basis.basis import AbstractDecomposition
from ...basis.decomposition.pod import POD
from ...common.errors import InputError, RankError, ReductionError
from ...common.extras import data_frame
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from ...reduction.reduce import reduce
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ..compare import compare
from ..sweeps.batch import simulate_all
from ..timing import timed
from .rank_search import held_out_error


class RankRow(NamedTuple):
    """One reduced model.

    - `trained`: its error on the training run; `held_out`: the largest on the variations, NaN
      without any. Infinite where a run fails.
    - `steps`, `least` [s]: of the training run, the least of several repeated ones.
    """

    formulation: str
    rank: int
    trained: float
    held_out: float
    steps: int
    least: float

    @property
    def error(self) -> float:
        """The larger one of both errors."""
        return max(self.trained, 0.0 if np.isnan(self.held_out) else self.held_out)


@dataclasses.dataclass(frozen=True)
class RankStudy:
    """Reduced models of several ranks, measured; made by `rank_study`.

    - `rows`: one for each model that was made, by formulation and rank; `models`: the reduced
      systems in the same order.
    - `full` [s]: the least time of the full model, by the method of the training.
    - `variations`: how many runs were held out.
    - `refused`: models that were not made, and why.
    """

    rows: tuple[RankRow, ...]
    models: tuple[AbstractReducedSystem, ...]
    full: float
    variations: int
    refused: dict[str, str]

    def paying(self, formulation: str | None = None) -> list[RankRow]:
        """Rows of models that succeed in less time than the full one, of one formulation or all."""
        return [
            row
            for row in self.rows
            if formulation in (None, row.formulation)
            and np.isfinite(row.error)
            and row.least < self.full
        ]

    def best(self, formulation: str | None = None) -> RankRow:
        """Return the one of the `paying` rows with the least product of error and steps.

        Steps grow with the frequency that a mode brings: it is worth that if the error falls by a
        larger factor than the steps grow. Raises InputError if no model pays.
        """
        rows = self.paying(formulation)
        if not rows:
            of = "" if formulation is None else f" of formulation {formulation!r}"
            raise InputError(
                f"rank_study: no model{of} is faster than the full one; try other formulations or "
                "smaller ranks."
            )
        return min(rows, key=lambda row: row.error * row.steps)

    def model(self, row: RankRow) -> AbstractReducedSystem:
        """The reduced system of a row."""
        return self.models[self.rows.index(row)]

    def table(self) -> Any:
        """All rows as a pandas data frame, with the speed-up (extra `study`)."""
        table = data_frame("RankStudy.table", self.rows, "the rows are in .rows")
        table["speed_up"] = self.full / table["least"]
        return table


def rank_study(
    system: AbstractSystem,
    training: Trajectory,
    variations: Sequence[AbstractSystem] = (),
    *,
    ranks: Iterable[int] = range(1, 9),
    formulations: Sequence[AbstractFormulation | str] = ("minimal", "local"),
    decomposition: AbstractDecomposition | None = None,
    rtol: float = 1e-8,
    repeats: int = 5,
    progress: bool = False,
) -> RankStudy:
    """Errors and times of reduced models by rank, on the training and on runs beyond it.

    `romjax.plot.reduction` draws them, and `RankStudy.best` is the rank whose modes pay for the
    steps that they cost.

    **Arguments:**

    - `system`: the full system; `training`: a run of it, more accurate than `rtol`.
    - `variations`: systems of the same structure with other numbers or starts, which no snapshot is
      from. They are simulated in one batch, by the method of the training and at its times.

    **Keyword arguments:**

    - `ranks`: numbers of modes; `formulations`: by name or as objects.
    - `decomposition`: `POD()` unless given.
    - `rtol`: relative tolerance of the reduced runs, by their default method, and of the full one
      that is timed, by the method of the training.
    - `repeats`: how often each run is timed; `progress`: show a progress bar.

    Raises InputError for ranks that are not positive, and for variations that differ in structure
    or cannot be simulated. Models that are refused are named in the result.
    """
    numbers = sorted(set(ranks))
    if not numbers or numbers[0] < 1 or repeats < 1:
        raise InputError(
            f"rank_study: ranks={numbers}, repeats={repeats}; give positive numbers of both."
        )
    method = POD() if decomposition is None else decomposition
    others = list(variations)
    truths = simulate_all("rank_study", others, training) if others else []
    rows, models, refused = [], [], {}
    pairs = [(as_formulation(name), rank) for name in formulations for rank in numbers]
    for formulation, rank in tqdm(pairs, disable=not progress, unit=" models", desc="rank_study"):
        try:
            basis = formulation.basis(system, training, method.with_rank(rank))
            # All formulations but those for reference make such systems.
            rom = reduce(system, basis, formulation)
        except (RankError, ReductionError) as error:
            refused[f"{formulation.name}, r = {rank}"] = str(error)
            continue
        run, least = _timed_run(rom, training, rtol, None, repeats)
        trained = float(compare(training, run).error)
        unseen = zip(others, truths, strict=True)
        errors = [held_out_error(rom, other, truth, rtol) for other, truth in unseen]
        rows.append(
            RankRow(
                formulation=formulation.name,
                rank=rank,
                trained=trained if np.isfinite(trained) else np.inf,
                held_out=max(errors, default=np.nan),
                steps=int(run.stats.num_steps),
                least=least,
            )
        )
        models.append(rom)
    full = _timed_run(system, training, rtol, training.solver, repeats)[1]
    return RankStudy(tuple(rows), tuple(models), full, len(others), refused)


def _timed_run(
    system: AbstractSystem,
    training: Trajectory,
    rtol: float,
    solver: diffrax.AbstractSolver[Any] | None,
    repeats: int,
) -> tuple[Trajectory, float]:
    """A run at the times of the training, and the least time of several that follow [s]."""

    def call() -> Trajectory:
        return simulate(system, training.t, rtol=rtol, solver=solver, throw=False)

    run, _ = timed(call)  # which compiles it
    return run, min(timed(call)[1] for _ in range(repeats))
