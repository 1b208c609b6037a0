"""What each mode of a reduced model buys."""

from typing import Any

import numpy as np
from matplotlib.ticker import LogFormatter

from ...study.rank_study import RankStudy
from ..style import COLOURS, MARKERS, SMALL, DisplayedFigure


def reduction(study: RankStudy) -> DisplayedFigure:
    """Error against time, each rank a point with its number; one colour for each formulation.

    Filled points are the largest error of the runs that were held out, hollow ones that of the
    training, and a vertical line joins the two of one model: a long one belongs to a model that
    reproduces its training but does not predict. The ring is around the rank whose modes pay for
    their steps (`RankStudy.best`); the dashed line is the time of the full model.
    """
    figure = DisplayedFigure(figsize=(6.5, 4.2))
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log")
    for index, name in enumerate(dict.fromkeys(row.formulation for row in study.rows), start=1):
        rows = [r for r in study.rows if r.formulation == name and np.isfinite(r.error)]
        if not rows:
            continue
        colour, marker = COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)]
        times = [1e3 * row.least for row in rows]
        trained = [row.trained for row in rows]
        errors = [row.error for row in rows]
        axes.vlines(times, trained, errors, color=colour, linewidth=0.8, alpha=0.5)
        style: dict[str, Any] = {"color": colour, "marker": marker, "markersize": 6}
        if study.variations:
            axes.plot(times, trained, linestyle="", markerfacecolor="white", **style)
        axes.plot(times, errors, linewidth=1.2, label=f'"{name}"', **style)
        for row, time in zip(rows, times, strict=True):
            axes.annotate(
                str(row.rank), (time, row.error), (4, 4), textcoords="offset points", fontsize=SMALL
            )
        if not study.paying(name):
            continue
        best = study.best(name)
        axes.plot(1e3 * best.least, best.error, "o", ms=14, mfc="none", mec=colour, mew=1.4)
    axes.axvline(1e3 * study.full, color="black", linestyle="--", linewidth=1)
    axes.plot([], [], "--", color="black", label="full model")
    if study.variations:
        axes.plot([], [], "o", color="0.3", label=f"largest of {study.variations} runs held out")
        axes.plot([], [], "o", color="0.3", markerfacecolor="white", label="training")
    axes.plot([], [], "o", ms=12, mfc="none", mec="0.3", label="modes that pay")
    axes.set(xlabel="time of a run [ms]", ylabel="error")
    for ticks in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        ticks(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.grid(color="0.9")
    figure.legend(loc="outside right upper", fontsize=SMALL)
    return figure
