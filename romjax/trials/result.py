"""The cost and the gain of reductions of a mechanism."""

import dataclasses
import textwrap
from collections.abc import Mapping
from typing import Any

from ..common.errors import InputError
from ..common.extras import data_frame
from ..common.plain import rounded, table
from ..integrate.trajectory import Trajectory
from ..system.base import AbstractSystem
from .row import ReductionRow

# Rows that a summary shows unless all are asked for.
_SHOWN = 6
_WIDTH = 80
# What judges a model, by how many there are of them.
_COUNTS = ("no", "one", "two", "three")


@dataclasses.dataclass(frozen=True)
class Reductions:
    """Reduced models of a scene, measured; made by `reductions`.

    - `rows`: one for each model, the recommended one first, then by how much faster they are;
      `models`: the systems in the same order; `runs`: their motions from the start of the scene.
    - `tol`: the error that a model may have. `full`: the row of the full model; `system` and
      `truth`: its system, and an accurate run of it, which errors are measured against; with its
      balance of energy, but for a model that takes long to compile and an interrupted study.
    - `advice`: which model to take and why, or why none pays, in words.
    - `refused`: what cannot reduce this mechanism, and `skipped`: what was not tried, by name, with
      the reason. `pays`: whether any is worth making. `unseen`: how many runs that no model has
      seen have judged them. `bar`: what `corrected` tells of the error of the recommended model on
      one of these, beside the true one, in words; "" where it tells nothing.
    """

    rows: tuple[ReductionRow, ...]
    models: tuple[AbstractSystem, ...]
    runs: tuple[Trajectory, ...]
    tol: float
    full: ReductionRow
    system: AbstractSystem
    truth: Trajectory
    advice: str
    refused: dict[str, str]
    skipped: dict[str, str]
    pays: bool
    unseen: int
    bar: str = ""

    @property
    def recommended(self) -> ReductionRow | None:
        """The row of the model that pays best; None where none does."""
        return self.rows[0] if self.pays else None

    def model(self, row: ReductionRow | None = None) -> AbstractSystem:
        """The system of a row, or of the recommended one: a reduced system, or with a cap the full
        one with slower modes.

        Raises InputError if none is recommended.
        """
        chosen = self.recommended if row is None else row
        if chosen is None:
            raise InputError(f"reductions: no model is recommended. {self.advice}")
        return self.models[self.rows.index(chosen)]

    def table(self) -> Any:
        """All rows as a pandas data frame, the full model first (extra `study`)."""
        return data_frame("Reductions.table", [self.full, *self.rows], "the rows are in .rows")

    def cells(self, every: bool = False) -> tuple[list[str], list[list[str]]]:
        """The header and the rows of the table in words, the best of them or `every` one."""
        header = ["model", "steps", "ms", "times", "trained", "unseen", "made s", "pays after"]
        rows = [_cells(self.full), *(_cells(row) for row in self.shown(every))]
        rows[0][3] = rows[0][7] = ""
        return header, rows

    def shown(self, every: bool = False) -> list[ReductionRow]:
        """The best rows, or `every` one."""
        return list(self.rows if every else self.rows[:_SHOWN])

    def notes(self, every: bool = False) -> list[str]:
        """Return notes on what the table means, what speaks against rows, and what is not in it."""
        rows = [self.full, *self.shown(every)]
        errors = "errors on the training"
        if any(row.unseen == row.unseen for row in rows):
            errors += f" and the largest on {_COUNTS[self.unseen]} unseen starts or speeds"
        notes = [
            f"times: as fast as the full model; {errors}; made: with training and compiling; "
            "pays after: runs."
        ]
        notes += [self.bar] * bool(self.bar)
        remarks = _names_by_words({row.name: row.remark for row in rows if row.remark})
        notes += [f"{'; '.join(names)}: {words}" for words, names in remarks.items()]
        if every:
            notes += [f"{name}: refused. {why}" for name, why in self.refused.items()]
        else:
            notes += [f"{name}: refused, {_first(why)}" for name, why in self.refused.items()]
            hidden = len(self.rows) - len(self.shown())
            more = "model is" if hidden == 1 else "models are"
            notes += [f"{hidden} more {more} slower or less accurate."] * (hidden > 0)
        left = _names_by_words(self.skipped)
        notes += [f"Not tried: {', '.join(names)}; {why}." for why, names in left.items()]
        return notes

    def summary(self, every: bool = False) -> str:
        """The advice, the table and its notes, at most 80 columns wide."""
        notes = [textwrap.fill(note, _WIDTH, subsequent_indent="  ") for note in self.notes(every)]
        return "\n".join(
            [textwrap.fill(self.advice, _WIDTH), "", table(*self.cells(every)), "", *notes]
        )


def _names_by_words(said: Mapping[str, str]) -> dict[str, list[str]]:
    """What is said of some names, each once, with the names that it is said of."""
    return {
        words: [name for name, other in said.items() if other == words]
        for words in dict.fromkeys(said.values())
    }


def _first(text: str) -> str:
    """The first sentence of a refusal."""
    sentence = text.removeprefix("reduce: ").partition(". ")[0].partition("; ")[0]
    return sentence.rstrip(".") + "."


def _cells(row: ReductionRow) -> list[str]:
    return [
        row.name,
        f"{row.steps}",
        rounded(1e3 * row.time),
        f"{row.speed_up:.1f}",
        _error(row.trained),
        _error(row.unseen),
        f"{row.made + row.compiled:.1f}",
        "never" if row.pays_after == float("inf") else f"{row.pays_after:.0f}",
    ]


def _error(error: float) -> str:
    if error != error:
        return "-"
    return "failed" if error == float("inf") else f"{error:.1e}"
