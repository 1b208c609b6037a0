"""The reduction study in words and in files."""

import textwrap
from pathlib import Path

import numpy as np
from tabulate import tabulate

from . import plot
from .basis.describe import describe
from .integrate.trajectory import Trajectory
from .scene.scene import Scene
from .study.projected import ProjectedSystem
from .study.reduction import ReductionStudy, Run

# Time saved in the chapter's section 39.4.2, by POD with six modes and by SOD with five.
CHAPTER = {"POD projected": "12 %", "SOD projected": "30 %"}


def summary(study: ReductionStudy, chapter: bool) -> str:
    """The table of the models, at most 80 columns wide, and the ranks at both sample rates."""
    header = ["model", "r", "kept", "dof", "steps", "comp. s", "run ms", "error", "speed-up"]
    text = [_table(header, [_row(run, study.full) for run in study.runs], chapter)]
    text.append("r modes, kept constraints, degrees of freedom; compile time apart.")
    if chapter:
        text.append("chapter: time that its models save; they are the projected ones.")
    text += [f"{name}: refused. {reason}" for name, reason in study.refused.items()]
    for basis in study.bases.values():
        text += ["", textwrap.fill(describe(basis), 80)]
    ranks = [[f"{r.rate:g} Hz", str(r.naive), str(r.pod), str(r.sod)] for r in study.ranks]
    text += ["", tabulate([["rank at", "naive SOD", "POD", "SOD"], *ranks], tablefmt="plain")]
    text.append("naive: generalised SVD of raw snapshots" + (" (chapter: 5, then 6)" * chapter))
    return "\n".join(text)


def _table(header: list[str], rows: list[list[str]], chapter: bool) -> str:
    if chapter:
        header = [*header, "chapter"]
        rows = [[*row, CHAPTER.get(row[0], "")] for row in rows]
    lines = [header, ["-" * len(name) for name in header], *rows]
    sides = ["left"] + ["right"] * (len(header) - 1)
    return tabulate(lines, tablefmt="plain", disable_numparse=True, colalign=sides)


def _row(run: Run, full: Run) -> list[str]:
    reduced, ok = run is not full, bool(run.trajectory.success)
    # The projected formulation keeps no constraint in the reduced coordinates.
    free = not isinstance(run.system, ProjectedSystem)
    return [
        run.name,
        str(run.system.n),
        str(run.system.m),
        str(run.system.n - run.system.m) if free else "",
        str(int(run.trajectory.stats["num_steps"])),
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
        best = "POD galerkin"
        shown = {"full": truth} | ({best: approx[best]} if best in approx else {})
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
