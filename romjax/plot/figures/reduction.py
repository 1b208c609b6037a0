"""Figure of the gain by each mode of a reduced model."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ...common.checks import check_kind
from ...study.ranks.rank_study import RankStudy
from ..labels import Label, place
from ..style import COLOURS, MARKERS, SMALL, DisplayedFigure


def reduction(study: RankStudy) -> DisplayedFigure:
    """Error against time, each rank a point with its number; one colour for each formulation.

    Filled points are the largest error of the runs that were held out, hollow ones that of the
    training, and a vertical line joins the two of one model: a long one belongs to a model that
    reproduces its training but does not predict. The ring is around the rank whose modes pay for
    their steps (`RankStudy.best`); the dashed line is the time of the full model.
    """
    check_kind("reduction", "the study", study, RankStudy, "what romjax.rank_study returns")
    figure, axes = blank()
    labels = list[Label]()
    for index, name in enumerate(dict.fromkeys(row.formulation for row in study.rows), start=1):
        rows = [r for r in study.rows if r.formulation == name and np.isfinite(r.error)]
        if not rows:
            continue
        points = [Point(row.least, row.trained, row.error, str(row.rank)) for row in rows]
        labels += draw(axes, index, f'"{name}"', points, apart=study.variations > 0)
        if study.paying(name):
            best = study.best(name)
            ring(axes, index, best.least, best.error)
    explain(figure, axes, study.full, study.variations, "modes that pay")
    place(figure, axes, labels)
    return figure


class Point(NamedTuple):
    """A model: the time of a run [s], its errors, what stands beside it, and whether runs that were
    held out have judged it.
    """

    time: float
    trained: float
    error: float
    words: str
    judged: bool = True


def blank() -> tuple[DisplayedFigure, Axes]:
    """A figure for errors against times, both logarithmic."""
    figure = DisplayedFigure(figsize=(6.5, 4.2))
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log")
    return figure, axes


def draw(axes: Axes, index: int, name: str, points: Sequence[Point], apart: bool) -> list[Label]:
    """Draw the models of one kind, and return the labels that go beside them once all is drawn.

    `index`: of its colour; `apart`: whether errors on the training are drawn too. Models that no
    run has judged that was held out have a hollow point only.
    """
    style = _style(index)
    colour = style["color"]
    times = [1e3 * point.time for point in points]
    trained, errors = [point.trained for point in points], [point.error for point in points]
    axes.vlines(times, trained, errors, color=colour, linewidth=0.8, alpha=0.5)
    hidden = list[Label]()
    if apart:
        axes.plot(times, trained, linestyle="", markerfacecolor="white", **style)
        hidden = [Label(*spot, "", colour) for spot in zip(times, trained, strict=True)]
    filled = [i for i, point in enumerate(points) if point.judged]
    axes.plot(times, errors, linewidth=1.2, label=name, markevery=filled, **style)
    alone = [i for i, point in enumerate(points) if not point.judged]
    spots = [times[i] for i in alone], [trained[i] for i in alone]
    axes.plot(*spots, linestyle="", markerfacecolor="white", **style)
    pairs = zip(points, times, strict=True)
    return [Label(time, point.error, point.words, colour) for point, time in pairs] + hidden


def hollow(axes: Axes, index: int, time: float, trained: float, name: str) -> Label:
    """Draw a model that fails on runs that it has not seen, at its time [ms]; returns its label."""
    axes.plot(time, trained, linestyle="", markerfacecolor="white", **_style(index))
    return Label(time, trained, f"{name}, fails unseen", COLOURS[index % len(COLOURS)])


def _style(index: int) -> dict[str, Any]:
    """The colour and marker of a kind."""
    colour, marker = COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)]
    return {"color": colour, "marker": marker, "markersize": 6}


def ring(axes: Axes, index: int, time: float, error: float) -> None:
    """Draw a ring around a model that is recommended."""
    colour = COLOURS[index % len(COLOURS)]
    axes.plot(1e3 * time, error, "o", ms=14, mfc="none", mec=colour, mew=1.4)


def frame(axes: Axes, index: int, time: float, error: float) -> None:
    """Draw a frame around the first model of a kind that is right."""
    colour = COLOURS[index % len(COLOURS)]
    axes.plot(1e3 * time, error, "s", ms=10, mfc="none", mec=colour, mew=1.0)


def explain(figure: Figure, axes: Axes, full: float, unseen: int, ringed: str) -> None:
    """Axes, the time of the full model [s], and what filled, hollow and ringed points mean."""
    axes.axvline(1e3 * full, color="black", linestyle="--", linewidth=1)
    axes.plot([], [], "--", color="black", label="full model")
    if unseen:
        axes.plot([], [], "o", color="0.3", label=f"largest of {unseen} runs held out")
        axes.plot([], [], "o", color="0.3", markerfacecolor="white", label="training")
    axes.plot([], [], "o", ms=12, mfc="none", mec="0.3", label=ringed)
    axes.set(xlabel="time of a run [ms]", ylabel="error")
    low, high = axes.get_xlim()
    # Numbers in between would touch where there are more decades.
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(color="0.9")
    figure.legend(loc="outside right upper", fontsize=SMALL)
