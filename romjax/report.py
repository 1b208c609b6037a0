"""The reduction study in words and in files."""

from pathlib import Path

import numpy as np
from tabulate import tabulate

from . import plot
from .integrate.trajectory import Trajectory
from .scene.scene import Scene
from .study.reduction import RANK_TOLERANCE, ReductionStudy, Run

# Time saved in the chapter's section 39.4.2, by POD with six modes and by SOD with five.
CHAPTER = {"POD projected": "12 %", "SOD projected": "30 %"}


def summary(study: ReductionStudy, chapter: bool) -> str:
    """The table of the models, at most 80 columns wide, and the ranks at both sample rates."""
    header = ["model", "r", "kept", "dof", "steps", "compile s", "run ms", "error", "speed-up"]
    header += ["chapter"] if chapter else []
    rows = [_row(run, study.full, chapter) for run in study.runs]
    text = [
        tabulate(
            rows, header, disable_numparse=True, colalign=["left"] + ["right"] * (len(header) - 1)
        )
    ]
    if chapter:
        text.append(
            "chapter: time that its reduced models save, which are the projected ones here."
        )
    text += [f"{name}: refused. {reason}" for name, reason in study.refused.items()]
    text.append("")
    ranks = [[f"{r.rate:g}", r.naive, r.pod, r.sod] for r in study.ranks]
    text.append(
        tabulate(
            ranks,
            ["rate Hz", "naive SOD", "POD", "SOD"],
            colalign=["right"] * 4,
        )
    )
    text.append(
        f"Ranks: of the modes of a generalised SVD of raw snapshots; ours at {RANK_TOLERANCE:g}."
    )
    return "\n".join(text)


def _row(run: Run, full: Run, chapter: bool) -> list[str]:
    reduced = run is not full
    ok = bool(run.trajectory.success)
    row = [
        run.name,
        str(run.system.n),
        str(run.system.m),
        str(run.system.n - run.system.m) if run.name != "POD projected" else "",
        str(int(run.trajectory.stats["num_steps"])),
        f"{run.compile_time:.1f}",
        f"{1e3 * run.run_time:.1f}",
        (f"{float(run.comparison.error):.1e}" if ok else "failed") if reduced else "",
        f"{full.run_time / run.run_time:.1f}" if ok and reduced else "",
    ]
    return row + ([CHAPTER.get(run.name, "")] if chapter else [])


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
        figure.savefig(folder / name, dpi=120)
        written.append(folder / name)
    if animation:
        best = "POD galerkin"
        shown = {"full": truth} | ({best: approx[best]} if best in approx else {})
        plot.animate(scene, shown, folder / "animation.gif")
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
