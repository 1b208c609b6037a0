"""The chapter's study in words: its table, its ranks and its bases."""

import math
import textwrap

from tabulate import tabulate

from ..basis.describe import describe
from ..common.plain import table
from ..gallery.catalogue import Example
from ..study.reduction import ReductionStudy, Run
from ..trials.advice import remark
from . import document

_RANKS = ["rank at", "naive SOD", "POD", "SOD"]


def summary(study: ReductionStudy, example: Example) -> str:
    """The table of the models, at most 80 columns wide, and the ranks at both sample rates; beside
    them what is published of the `example`.
    """
    header, rows = _models(study, example)
    notes = [textwrap.fill(note, 80, subsequent_indent="  ") for note in _notes(study, example)]
    text = ["POD and SOD, in the formulations of the chapter:", "", table(header, rows), *notes]
    for basis in study.bases.values():
        text += ["", textwrap.fill(describe(basis), 80)]
    text += ["", tabulate([_RANKS, *_ranks(study)], tablefmt="plain"), _naive(example)]
    return "\n".join(text)


def parts(study: ReductionStudy, example: Example) -> list[str]:
    """The same as parts of a page."""
    return [
        document.heading("POD and SOD"),
        document.table(*_models(study, example)),
        document.bullets(_notes(study, example)),
        document.table(_RANKS, _ranks(study)),
        document.paragraph(_naive(example)),
    ]


def _models(study: ReductionStudy, example: Example) -> tuple[list[str], list[list[str]]]:
    """The header and the rows of the table of models."""
    header = ["model", "r", "kept", "dof", "steps", "comp. s", "run ms", "error", "speed-up"]
    rows = [_row(run, study.full) for run in study.runs]
    if example.published_savings:
        header.append("chapter")
        for row, run in zip(rows, study.runs, strict=True):
            row.append(_published(run, example))
    return header, rows


def _notes(study: ReductionStudy, example: Example) -> list[str]:
    """Return notes on what the table means, and on the models that were refused."""
    notes = ["r modes, kept constraints, degrees of freedom; compile time apart."]
    if example.published_savings:
        notes.append("chapter: time that its models save; they are the projected ones.")
    for run in study.runs[1:]:
        failed = not bool(run.trajectory.success)
        error = math.inf if failed else float(run.comparison.error)
        hidden = run.comparison.hidden()
        said = remark(error, math.nan, 0.0, run.trajectory.each_warning(), hidden)
        notes += [f"{run.name}: {said}"] * bool(said)
    return notes + [f"{name}: refused. {reason}" for name, reason in study.refused.items()]


def _ranks(study: ReductionStudy) -> list[list[str]]:
    return [[f"{r.rate:g} Hz", str(r.naive), str(r.pod), str(r.sod)] for r in study.ranks]


def _naive(example: Example) -> str:
    published = ", then ".join(str(rank) for rank in example.published_ranks)
    return "naive: generalised SVD of raw snapshots" + f" (chapter: {published})" * bool(published)


def _published(run: Run, example: Example) -> str:
    """The published saving of a model; published models are those for reference."""
    if run.basis is None or run.formulation is None or not run.formulation.for_reference:
        return ""
    saving = example.published_savings.get(run.basis.name)
    return "" if saving is None else f"{100 * saving:.0f} %"


def _row(run: Run, full: Run) -> list[str]:
    reduced, ok = run is not full, bool(run.trajectory.success)
    freedoms = run.degrees_of_freedom
    return [
        run.name,
        str(run.system.n),
        str(run.system.m),
        "" if freedoms is None else str(freedoms),
        str(int(run.trajectory.stats.num_steps)),
        f"{max(0.0, run.compile_time):.1f}",  # a later call may take longer
        f"{1e3 * run.run_time:.1f}",
        (f"{float(run.comparison.error):.1e}" if ok else "failed") if reduced else "",
        f"{full.run_time / run.run_time:.1f}" if ok and reduced else "",
    ]
