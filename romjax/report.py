"""The reduction study in words and in files: one page, and what it is made of."""

import textwrap
from pathlib import Path

import numpy as np
from tabulate import tabulate

from . import csv_table, document, plot, writing
from .basis.describe import describe
from .gallery.catalogue import Example
from .integrate.trajectory import Trajectory
from .plot.motion.animate import animate
from .plot.motion.animation import Animation
from .scene.scene import Scene
from .study.reduction import ReductionStudy, Run


def line(run: Run) -> str:
    """What is known of a model as soon as it has run."""
    steps = int(run.trajectory.stats.num_steps)
    text = f"{run.name}: {run.system.n} coordinates, {steps} steps in {1e3 * run.run_time:.1f} ms"
    if not bool(run.trajectory.success):
        return f"{text}, failed"
    return text if run.basis is None else f"{text}, error {float(run.comparison.error):.1e}"


def summary(study: ReductionStudy, example: Example) -> str:
    """The table of the models, at most 80 columns wide, and the ranks at both sample rates; beside
    them what is published of the `example`.
    """
    header, rows = _models(study, example)
    text = [_table(header, rows), *_notes(study, example)]
    for basis in study.bases.values():
        text += ["", textwrap.fill(describe(basis), 80)]
    text += ["", tabulate([_RANKS, *_ranks(study)], tablefmt="plain"), _naive(example)]
    return "\n".join(text)


_RANKS = ["rank at", "naive SOD", "POD", "SOD"]


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
    """What the table means, and which models were refused."""
    notes = ["r modes, kept constraints, degrees of freedom; compile time apart."]
    if example.published_savings:
        notes.append("chapter: time that its models save; they are the projected ones.")
    return notes + [f"{name}: refused. {reason}" for name, reason in study.refused.items()]


def _ranks(study: ReductionStudy) -> list[list[str]]:
    return [[f"{r.rate:g} Hz", str(r.naive), str(r.pod), str(r.sod)] for r in study.ranks]


def _naive(example: Example) -> str:
    published = ", then ".join(str(rank) for rank in example.published_ranks)
    return "naive: generalised SVD of raw snapshots" + f" (chapter: {published})" * bool(published)


def _table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["-" * len(name) for name in header], *rows]
    sides = ["left"] + ["right"] * (len(header) - 1)
    return tabulate(lines, tablefmt="plain", disable_numparse=True, colalign=sides)


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


def write(
    study: ReductionStudy, scene: Scene, example: Example, folder: Path, animation: bool
) -> list[Path]:
    """Write the page, figures, the animation and the trajectories into `folder`; returns the files,
    the page first.

    The page holds all that can be looked at. The figures and the GIF are for papers and slides.
    """
    truth = study.full.trajectory
    approx = {run.name: run.trajectory for run in study.runs[1:] if bool(run.trajectory.success)}
    drawn = {
        "responses": plot.response(truth, *approx.values(), labels=["full", *approx]),
        "errors": plot.errors(truth, approx),
        "singular_values": plot.values(*study.bases.values()),
    }
    for name, basis in study.bases.items():
        drawn[f"modes_{name.lower()}"] = plot.modes(scene, basis)
    pictures = {name: document.png(figure, dpi=100) for name, figure in drawn.items()}
    moving = None
    if animation:
        shown = {"full": truth} | dict(list(approx.items())[:1])
        moving = animate(scene, *shown.values(), labels=list(shown), title=example.name)
    page = folder / "report.html"
    writing.write(page, _page(study, example, pictures, moving))
    written = [page]
    for name, content in pictures.items():
        written.append(folder / f"{name}.png")
        writing.write(written[-1], content)
    if moving is not None:
        written.append(moving.save(folder / "animation.gif", fps=20, progress=False))
    for name, trajectory in {"full": truth, **approx}.items():
        written.append(
            _write_csv(folder / f"trajectory_{name.lower().replace(' ', '_')}.csv", trajectory)
        )
    return written


def _page(
    study: ReductionStudy,
    example: Example,
    pictures: dict[str, bytes],
    moving: Animation | None,
) -> str:
    """Table, moving mechanism and figures in one."""
    full = study.full
    parts = [
        document.paragraph(
            f"{example.title}: {full.system.n} coordinates, {full.system.m} constraints, "
            f"{float(full.trajectory.t[-1]):g} s."
        ),
        "" if moving is None else moving.embedded(),
        document.heading("Models"),
        document.table(*_models(study, example)),
        document.bullets(_notes(study, example)),
        document.heading("Bases"),
        *(document.paragraph(describe(basis)) for basis in study.bases.values()),
        document.table(_RANKS, _ranks(study)),
        document.paragraph(_naive(example)),
        document.heading("Figures"),
        *(document.picture(content, name) for name, content in pictures.items()),
    ]
    return document.document(example.name, *parts)


def _write_csv(path: Path, trajectory: Trajectory) -> Path:
    """Time, coordinates, velocities and multipliers as comma-separated columns with a header."""
    labels = ["t", *trajectory.labels, *(f"d/dt {label}" for label in trajectory.labels)]
    labels += [f"lambda{i + 1}" for i in range(trajectory.multipliers.shape[1])]
    columns = [trajectory.t[:, None], trajectory.q, trajectory.v, trajectory.multipliers]
    csv_table.write(path, labels, np.concatenate(columns, axis=1).tolist())
    return path
