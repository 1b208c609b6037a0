"""A study of accuracy in words and in files: a table, a figure and a page that holds both."""

import datetime
import math
import os
import platform
import textwrap
from pathlib import Path

import jax
from tabulate import tabulate

from .. import plot
from ..common import writing
from ..plot.png import png
from ..study.accuracy.recommendation import Recommendation
from ..study.accuracy.result import Accuracy
from ..study.accuracy.row import SINGLE_RUN, Condition, Row
from . import csv_table, document

# Errors that the page and the command line recommend something for.
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)

_PICTURE = (
    "Time against error of all models and methods, error against rank and over time, and when "
    "reduction pays"
)
_ALL = """Bold: nothing else under the same condition is as accurate in less time. Times are the
least of interleaved runs, of one run where many go at once. The first answer takes the time to make
a reduced model and to compile it, or to read it from disk, besides; so does when it pays."""


def summary(result: Accuracy) -> str:
    """Return tables, at most 80 columns wide, of what to use for which error, and of the errors."""
    header = ["error", "model", "method", "rtol", "reached", "ms", "pays after"]
    sides = ("left", "left", "left", *["right"] * (len(header) - 3))
    text = ""
    for lanes in result.lanes:
        rows = []
        for advice in recommendations(result, lanes):
            row, runs = advice.row, result.break_even(advice.row)
            cells = [row.model, row.solver, _setting(row), f"{row.error:.1e}"]
            pays = "" if runs is None else f"{runs:,.0f} runs" if math.isfinite(runs) else "never"
            rows.append([f"{advice.error:g}", *cells, f"{1e3 * row.least:.2f}", pays])
        text += f"Of {lanes} runs at once, each:\n" if lanes > 1 else ""
        text += tabulate(rows, header, tablefmt="plain", disable_numparse=True, colalign=sides)
        text += "\n\n"
    text += textwrap.fill(_reference(result), 80)
    if result.skipped:
        text += (
            f"\n{len(result.skipped)} configurations were refused or left out; the page says which."
        )
    return text


def recommendations(result: Accuracy, lanes: int = 1) -> list[Recommendation]:
    """Return a recommendation for each of the usual errors that some row of the study reaches."""
    front = result.front(Condition(SINGLE_RUN.precision, lanes))
    least = min((row.error for row in front), default=math.inf)
    return [result.recommend(error, lanes=lanes) for error in ERRORS if error >= least]


def _setting(row: Row) -> str:
    """The tolerance, or the fixed step with its name."""
    return f"{row.rtol:.0e}" if "rtol" in row.settings else f"dt={row.dt:.0e}"


def write(result: Accuracy, title: str, folder: Path) -> list[Path]:
    """Write the rows, the figure and the page into `folder`; returns the files."""
    table, figure, page = (folder / f"accuracy.{kind}" for kind in ("csv", "png", "html"))
    picture = png(plot.accuracy(result), dpi=130)
    with writing.together():
        csv_table.write(table, Row._fields, result.rows)
        writing.write(figure, picture)
        writing.write(page, _page(result, title, picture))
    return [table, figure, page]


def _page(result: Accuracy, title: str, picture: bytes) -> str:
    header = [
        "model",
        "method",
        "rtol",
        "precision",
        "at once",
        "error",
        "ms",
        "compile s",
        "first s",
        "steps",
    ]
    header += ["evaluations", "factorisations", "kB", "to make s"]
    rows = sorted(result.rows, key=lambda row: (row.error != row.error, row.error))
    # One line for each row, with the least of the errors that it is for.
    advised = {advice.row: advice for n in result.lanes for advice in recommendations(result, n)}
    device = jax.devices()[0]
    machine = (
        f"{datetime.date.today()}, {os.cpu_count()} cores, {platform.machine()}, "
        f"{device.device_kind}; Python {platform.python_version()}, jax {jax.__version__}"
    )
    skipped = [f"{name}: {why}" for name, why in result.skipped.items()]
    return document.document(
        title,
        document.paragraph(_reference(result)),
        document.heading("What to use"),
        document.bullets([advice.words for advice in advised.values()]),
        document.picture(picture, _PICTURE),
        document.heading("All that was measured"),
        document.paragraph(_ALL),
        document.table(header, [_row(row) for row in rows], [bool(row.pareto) for row in rows]),
        *([document.heading("Not measured"), document.bullets(skipped)] if skipped else []),
        document.paragraph(machine),
        left=2,
    )


def _reference(result: Accuracy) -> str:
    apart = f": they differ by {result.floor:.0e}." if math.isfinite(result.floor) else "."
    return f"Errors against {result.reference}{apart}"


def _row(row: Row) -> list[str]:
    """A row in words, the most telling columns first."""
    return [
        row.model,
        row.solver,
        _setting(row),
        row.precision,
        f"{row.lanes}",
        row.failure or f"{row.error:.1e}",
        f"{1e3 * row.least:.2f}",
        f"{row.compile:.1f}",
        f"{row.first:.1f}",
        f"{row.steps}",
        f"{row.evaluations}",
        f"{row.factorizations}",
        f"{row.memory / 1e3:.0f}",
        f"{row.offline:.1f}" if row.offline else "",
    ]
