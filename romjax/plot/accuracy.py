"""What accuracy costs in time."""

import numpy as np
from matplotlib.axes import Axes

from ..study.accuracy.result import Accuracy, Row
from .style import COLOURS, DASHES, GREY, MARKERS, SMALL, DisplayedFigure

# Methods differ in the line, models in colour and marker; what comes after the seventh is grey.
LINES = dict(zip(("Rodas5P", "Dopri8", "Tsit5", "Kvaerno5"), DASHES, strict=False))


def accuracy(result: Accuracy) -> DisplayedFigure:
    """Time against error, with the Pareto front; error against rank; when reduction pays.

    Left: one line for each model and method, by tolerance; the way of least time for each error is
    drawn wide and grey, failed runs are crosses on the left edge, and errors in the shaded strip
    are not told from that of the reference. Middle: the least error of each reduced model. Right:
    time of many runs, the making of the model included, each model at its smallest error.
    """
    figure = DisplayedFigure(figsize=(12, 5))
    figure.set_layout_engine("constrained")
    work, ranks, many = figure.subplots(1, 3, width_ratios=(2, 1, 1.3))
    _work(work, result)
    _ranks(ranks, result)
    _many(many, result)
    handles, labels = work.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize=SMALL)
    return figure


def _look(result: Accuracy, model: str) -> dict[str, object]:
    place = list(result.models).index(model)
    known = place < len(COLOURS)
    marker = MARKERS[place] if known else "."
    return {"color": COLOURS[place] if known else GREY, "marker": marker or ".", "markersize": 5}


def _good(result: Accuracy, **wanted: str) -> list[Row]:
    """Runs that did not fail and were timed, by error."""
    rows = [row for row in result.rows if not row.failure and np.isfinite(row.least)]
    fitting = [r for r in rows if all(getattr(r, key) == value for key, value in wanted.items())]
    return sorted(fitting, key=lambda row: row.error)


def _work(axes: Axes, result: Accuracy) -> None:
    front = result.front()
    axes.plot(
        [row.error for row in front],
        [1e3 * row.least for row in front],
        color="0.8",
        linewidth=7,
        solid_capstyle="round",
        label="least time",
        zorder=0,
    )
    for model, solver in dict.fromkeys((row.model, row.solver) for row in result.rows):
        rows = _good(result, model=model, solver=solver)
        axes.plot(
            [row.error for row in rows],
            [1e3 * row.least for row in rows],
            linestyle=LINES.get(solver, DASHES[-1]),
            linewidth=1.2,
            markerfacecolor="white",
            **_look(result, model),
        )
    # Models have a colour and a marker, methods a line: a legend of their sum, not their product.
    for model in dict.fromkeys(row.model for row in result.rows):
        axes.plot([], [], "-", markerfacecolor="white", label=model, **_look(result, model))
    for solver in dict.fromkeys(row.solver for row in result.rows):
        axes.plot([], [], color="black", linestyle=LINES.get(solver, DASHES[-1]), label=solver)
    axes.set(xscale="log", yscale="log", xlabel="error", ylabel="time of a run [ms]")
    failed = [row for row in result.rows if row.failure]
    if failed:
        place = 2 * max((row.error for row in _good(result)), default=1.0)
        times = [np.nanmax([row.least, 1e-4]) * 1e3 for row in failed]
        axes.plot([place] * len(failed), times, "x", color="black", label="failed")
    low, high = axes.get_xlim()
    if low < result.floor:
        axes.axvspan(low, result.floor, color="0.9", zorder=0)
    axes.set_xlim(high, low)
    axes.set_title("What accuracy costs", fontsize=11)
    axes.grid(color="0.9")


def _ranks(axes: Axes, result: Accuracy) -> None:
    kinds = dict.fromkeys(
        model.name.partition(",")[0] for model in result.models.values() if model.basis
    )
    for place, kind in enumerate(kinds, start=1):
        least: dict[int, float] = {}
        for row in _good(result):
            if row.model.partition(",")[0] == kind:
                least[row.rank] = min(row.error, least.get(row.rank, np.inf))
        pairs = sorted(least.items())
        axes.semilogy(
            [rank for rank, _ in pairs],
            [error for _, error in pairs],
            color=COLOURS[place % len(COLOURS)],
            linestyle=DASHES[place % len(DASHES)],
            marker=MARKERS[place % len(MARKERS)] or ".",
            markerfacecolor="white",
            label=kind,
        )
    if kinds:
        axes.legend(fontsize=SMALL)
    axes.set(xlabel="modes", ylabel="least error")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title("Rank", fontsize=11)
    axes.grid(color="0.9")


def _many(axes: Axes, result: Accuracy) -> None:
    runs = np.geomspace(1, 1e5, 101)
    for model in result.models:
        rows = _good(result, model=model)
        if rows:
            look = {**_look(result, model), "marker": ""}
            axes.loglog(runs, rows[0].offline + runs * rows[0].least, **look)
    crossings = [(result.break_even(row), row.model) for row in result.front()]
    paying = [(runs, model) for runs, model in crossings if runs is not None and np.isfinite(runs)]
    if paying:
        least, model = min(paying)
        axes.axvline(least, color="0.6", linewidth=1, linestyle=":")
        axes.annotate(
            f"{model}\npays after {least:.0f} runs",
            (least, 0.02),
            xycoords=("data", "axes fraction"),
            fontsize=SMALL,
            xytext=(4, 0),
            textcoords="offset points",
        )
    axes.set(xlabel="runs", ylabel="time with the making of the model [s]")
    axes.set_title("When reduction pays", fontsize=11)
    axes.grid(color="0.9")
