"""One panel per coordinate over time, in a grid."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..common.checks import check_kind, check_order
from ..integrate.trajectory import Trajectory
from ..study.compare import same_times
from .style import SMALL, DisplayedFigure


def check_motion(owner: str, motion: Trajectory) -> None:
    """Raise ValueError unless `motion` is a single motion: a run, and not a batch."""
    check_kind(owner, "the motion", motion, Trajectory, "what romjax.simulate(system, ts) returns")
    shape, count = np.shape(motion.q), len(motion.coordinates)
    if len(shape) != 2 or shape[1] != count:
        raise ValueError(
            f"{owner}: q has shape {shape} for {count} labels, but it "
            "must be (times, coordinates); take one motion out of a batch, such as "
            "jax.tree.map(lambda x: x[0], trajectory)."
        )


def check_coordinates(owner: str, truth: Trajectory, name: str, approx: Trajectory) -> None:
    """Raise ValueError unless both are single motions of equally many coordinates."""
    check_motion(f"{owner}: the truth", truth)
    check_motion(f"{owner}: '{name}'", approx)
    if truth.q.shape[1] != approx.q.shape[1]:
        raise ValueError(
            f"{owner}: '{name}' has {approx.q.shape[1]} coordinates, but the truth has "
            f"{truth.q.shape[1]}; plot models of one mechanism."
        )
    check_order(f"{owner}: '{name}'", truth.labels, approx.labels, ValueError)


def check_same_times(owner: str, truth: Trajectory, name: str, approx: Trajectory) -> None:
    """Raise ValueError unless both motions have the same output times."""
    t, other = np.asarray(truth.t), np.asarray(approx.t)
    if t.shape != other.shape or not same_times(t, other):
        raise ValueError(
            f"{owner}: '{name}' has {_times(approx)}, but the truth has {_times(truth)}; "
            "simulate both with the same ts."
        )


def _times(motion: Trajectory) -> str:
    t = np.asarray(motion.t)
    return f"{len(t)} times from {t[0]:g} s to {t[-1]:g} s"


def grid(count: int) -> tuple[Figure, list[Axes]]:
    """`count` panels over a shared time axis, in two columns if there are more than three.

    Column after column. An odd number leaves the upper right cell free, for the legend: there it
    separates no panel from the time axis below.
    """
    columns = 1 if count <= 3 else 2
    rows = -(-count // columns)
    figure = DisplayedFigure(figsize=(6.5 if columns == 1 else 9.0, 1.3 + 1.45 * rows))
    figure.set_layout_engine("constrained")
    cells = figure.add_gridspec(rows, columns)
    free = rows * columns - count
    panels: list[Axes] = []
    for cell in range(count):
        column, row = divmod(cell + (free if cell >= rows else 0), rows)
        axes = figure.add_subplot(cells[row, column], sharex=panels[0] if panels else None)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
        axes.tick_params(labelbottom=row == rows - 1)
        if row == rows - 1:
            axes.set_xlabel("time $t$ [s]")
        panels.append(axes)
    if free:
        figure.add_subplot(cells[0, 1]).set_axis_off()
    return figure, panels


def finish(figure: Figure, panels: list[Axes], title: str, note: str, key: str = "") -> None:
    """Title and note above, and one legend with the heading `key` for all panels."""
    figure.suptitle(f"{title}\n{note}" if note else title, fontsize=11)
    figure.align_ylabels(panels)
    handles, names = panels[0].get_legend_handles_labels()
    style = {"fontsize": SMALL + 1, "title": key or None, "title_fontsize": SMALL + 1}
    free = [axes for axes in figure.axes if axes not in panels]
    if free:
        free[0].legend(handles, names, loc="center", **style)
    else:
        columns = max(1, min(len(names), 100 // (8 + max(map(len, names)))))
        figure.legend(handles, names, loc="outside lower center", ncols=columns, **style)
