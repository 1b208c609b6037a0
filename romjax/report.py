"""The reduction study in words and in files."""

import textwrap
from pathlib import Path

import numpy as np
from tabulate import tabulate

from . import plot
from .basis.describe import describe
from .gallery.catalogue import Example
from .integrate.trajectory import Trajectory
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
    header = ["model", "r", "kept", "dof", "steps", "comp. s", "run ms", "error", "speed-up"]
    rows = [_row(run, study.full) for run in study.runs]
    text = []
    if example.published_savings:
        header.append("chapter")
        for row, run in zip(rows, study.runs, strict=True):
            row.append(_published(run, example))
        text.append("chapter: time that its models save; they are the projected ones.")
    text.insert(0, "r modes, kept constraints, degrees of freedom; compile time apart.")
    text.insert(0, _table(header, rows))
    text += [f"{name}: refused. {reason}" for name, reason in study.refused.items()]
    for basis in study.bases.values():
        text += ["", textwrap.fill(describe(basis), 80)]
    ranks = [[f"{r.rate:g} Hz", str(r.naive), str(r.pod), str(r.sod)] for r in study.ranks]
    text += ["", tabulate([["rank at", "naive SOD", "POD", "SOD"], *ranks], tablefmt="plain")]
    published = ", then ".join(str(rank) for rank in example.published_ranks)
    text.append(
        "naive: generalised SVD of raw snapshots" + f" (chapter: {published})" * bool(published)
    )
    return "\n".join(text)


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
        f"{run.compile_time:.1f}",
        f"{1e3 * run.run_time:.1f}",
        (f"{float(run.comparison.error):.1e}" if ok else "failed") if reduced else "",
        f"{full.run_time / run.run_time:.1f}" if ok and reduced else "",
    ]


def write(study: ReductionStudy, scene: Scene, folder: Path, animation: bool) -> list[Path]:
    """Write figures, the animation and the trajectories into `folder`; returns the files."""
    truth = study.full.trajectory
    approx = {run.name: run.trajectory for run in study.runs[1:] if bool(run.trajectory.success)}
    figures = {
        "singular_values.png": plot.values(*study.bases.values()),
        "responses.png": plot.response(truth, *approx.values(), labels=["full", *approx]),
        "errors.png": plot.errors(truth, approx),
    }
    for name, basis in study.bases.items():
        figures[f"modes_{name.lower()}.png"] = plot.modes(scene, basis)
    written = []
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=100)
        written.append(folder / name)
    if animation:
        shown = {"full": truth} | dict(list(approx.items())[:1])
        plot.animate(scene, shown, folder / "animation.gif", fps=20, seconds=2.0)
        written.append(folder / "animation.gif")
    for name, trajectory in {"full": truth, **approx}.items():
        written.append(
            _write_csv(folder / f"trajectory_{name.lower().replace(' ', '_')}.csv", trajectory)
        )
    return written


def _write_csv(path: Path, trajectory: Trajectory) -> Path:
    """Time, coordinates, velocities and multipliers as comma-separated columns with a header."""
    labels = ["t", *trajectory.labels, *(f"d/dt {label}" for label in trajectory.labels)]
    labels += [f"lambda{i + 1}" for i in range(trajectory.multipliers.shape[1])]
    columns = [trajectory.t[:, None], trajectory.q, trajectory.v, trajectory.multipliers]
    np.savetxt(
        path, np.concatenate(columns, axis=1), delimiter=",", header=",".join(labels), comments=""
    )
    return path
