"""Figure of the time that accuracy costs."""

from typing import TypedDict

import numpy as np
from matplotlib.axes import Axes

from ...common.checks import check_kind
from ...study.accuracy.result import Accuracy
from ...study.accuracy.row import SINGLE_RUN, Condition, Row
from ..style import COLOURS, DASHES, MARKERS, SMALL, DisplayedFigure

# Errors whose cheapest ways are drawn over time.
SHOWN = (1e-3, 1e-5, 1e-7)
WORDS = {"f64": "double precision", "f32": "single precision"}


def accuracy(result: Accuracy) -> DisplayedFigure:
    """Time against error, with the Pareto front; error against rank and over time; when reduction
    pays.

    Top, a panel for each precision and number of lanes: one line for each model and method, by
    tolerance or, with a star, by fixed step; the way of least time for each error is drawn wide and
    grey, failed runs are crosses on the left edge at the time until they failed, and errors in the
    shaded strip are not told from that of the reference. Below: the least error of each reduced
    model; the error over time (as in chapter Fig. 39.5, here of the whole motion in the energy
    norm) of the cheapest ways to three errors; and the time of many such runs, the making of the
    model included, against that of the full model at the same error, with the number of runs from
    which on reduction pays.
    """
    check_kind("accuracy", "the result", result, Accuracy, "what romjax.accuracy returns")
    figure = DisplayedFigure(figsize=(12, 8.5))
    figure.set_layout_engine("constrained")
    top, below = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=(1.25, 1)))
    conditions = [SINGLE_RUN, *(c for c in result.conditions if c != SINGLE_RUN)]
    widths = (1.5, *[1] * (len(conditions) - 1))
    panels = top.subplots(
        1, len(conditions), sharex=True, sharey=True, squeeze=False, width_ratios=widths
    )[0]
    for axes, condition in zip(panels, conditions, strict=True):
        _work(axes, result, condition)
    panels[0].set_ylabel("time of a run [ms]")
    panels[0].invert_xaxis()
    for axes, condition in zip(panels, conditions, strict=True):
        _edges(axes, result, condition)
    _explain(panels[0], result)
    ranks, history, many = below.subplots(1, 3, width_ratios=(1, 1.3, 1.3))
    _ranks(ranks, result)
    _history(history, result)
    _many(many, result)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize=SMALL)
    return figure


def _kind(model: str) -> str:
    """Basis and formulation of a model's name."""
    return model.partition(",")[0]


class _Style(TypedDict):
    color: str
    marker: str
    markersize: float
    markerfacecolor: str


def _style(result: Accuracy, model: str) -> _Style:
    """The colour of a kind of models, the marker of one of them; the full model is a black dot."""
    kinds = list(dict.fromkeys(map(_kind, result.models)))
    own = [name for name in result.models if _kind(name) == _kind(model)]
    marker = MARKERS[1 + own.index(model) % (len(MARKERS) - 1)] if "," in model else "."
    colour = COLOURS[kinds.index(_kind(model)) % len(COLOURS)]
    return {"color": colour, "marker": marker, "markersize": 5, "markerfacecolor": "white"}


def _method(row: Row) -> str:
    return row.solver + " *" * bool(row.dt > 0)


def _dashes(result: Accuracy) -> dict[str, object]:
    """The line of each method."""
    names = dict.fromkeys(_method(row) for row in result.rows)
    return {name: DASHES[i % len(DASHES)] for i, name in enumerate(names)}


def _good(result: Accuracy, condition: Condition = SINGLE_RUN) -> list[Row]:
    """Runs that did not fail, by error."""
    own = [row for row in result.rows if not row.failure and row.condition == condition]
    return sorted(own, key=lambda row: row.error)


def _work(axes: Axes, result: Accuracy, condition: Condition) -> None:
    front, dashes = result.front(condition), _dashes(result)
    axes.loglog(
        [row.error for row in front],
        [1e3 * row.least for row in front],
        color="0.8",
        linewidth=7,
        marker="o",
        solid_capstyle="round",
        zorder=0,
    )
    good = _good(result, condition)
    for model, method in dict.fromkeys((row.model, _method(row)) for row in good):
        rows = [row for row in good if (row.model, _method(row)) == (model, method)]
        axes.plot(
            [row.error for row in rows],
            [1e3 * row.least for row in rows],
            linestyle=dashes[method],
            linewidth=1.2,
            **_style(result, model),
        )
    many = f", {condition.lanes} at once" if condition.lanes > 1 else ""
    axes.set_title(f"{WORDS[condition.precision]}{many}", fontsize=11)
    axes.set_xlabel("error")
    axes.grid(color="0.9")


def _edges(axes: Axes, result: Accuracy, condition: Condition) -> None:
    """Mark failed runs, and errors that cannot be told from that of the reference."""
    worst, least = axes.get_xlim()
    failed = [row for row in result.rows if row.failure and row.condition == condition]
    times = [1e3 * row.least for row in failed]
    edge = axes.get_yaxis_transform()  # along the axis in fractions of it
    axes.plot([0.02] * len(failed), times, "x", color="black", zorder=5, transform=edge)
    if least < result.floor:
        axes.axvspan(least, result.floor, color="0.9", zorder=0)
    axes.set_xlim(worst, least)


def _explain(axes: Axes, result: Accuracy) -> None:
    """Models have a colour and a marker, methods a line: a legend of their sum, not product."""
    axes.plot([], [], color="0.8", linewidth=7, label="least time")
    for model in dict.fromkeys(row.model for row in result.rows):
        axes.plot([], [], "-", label=model, **_style(result, model))
    for method, dashes in _dashes(result).items():
        label = method.replace(" *", " * (fixed steps)")
        axes.plot([], [], color="black", linestyle=dashes, label=label)
    if any(row.failure for row in result.rows):
        axes.plot([], [], "x", color="black", label="failed")


def _ranks(axes: Axes, result: Accuracy) -> None:
    least: dict[str, dict[int, float]] = {}
    for row in reversed(_good(result)):  # the least error last
        if not row.is_full:
            least.setdefault(_kind(row.model), {})[row.rank] = row.error
    for index, (kind, errors) in enumerate(sorted(least.items()), start=1):
        ranks = sorted(errors)
        colour = _style(result, next(name for name in result.models if _kind(name) == kind))[
            "color"
        ]
        axes.semilogy(
            ranks,
            [errors[rank] for rank in ranks],
            color=colour,
            linestyle=DASHES[index % len(DASHES)],
            marker=".",
            label=kind,
        )
    if least:
        axes.legend(fontsize=SMALL)
    axes.set(xlabel="modes", ylabel="least error")
    axes.locator_params(axis="x", integer=True)
    axes.set_title("Rank", fontsize=11)
    axes.grid(color="0.9")


def _cheapest(result: Accuracy) -> list[Row]:
    """The ways of least time to the errors that are shown, as far as anything reaches them."""
    good = [[row for row in result.front() if row.error <= error] for error in SHOWN]
    return list(dict.fromkeys(rows[0] for rows in good if rows))


def _history(axes: Axes, result: Accuracy) -> None:
    for row in _cheapest(result):
        history = result.histories[result.rows.index(row)]
        axes.semilogy(
            result.times,
            np.where(history > 0, history, np.nan),
            linestyle=_dashes(result)[_method(row)],
            linewidth=1.2,
            markevery=max(1, len(history) // 8),
            label=f"{row.model}, {row.solver}: {row.error:.0e}",
            **_style(result, row.model),
        )
    if axes.lines:
        axes.legend(fontsize=SMALL, loc="lower right")
        axes.set_ylim(axes.get_ylim()[0] / 30)  # room for it
    axes.set(xlabel="time [s]", ylabel="error")
    axes.set_title("Error over time", fontsize=11)
    axes.grid(color="0.9")


def _many(axes: Axes, result: Accuracy) -> None:
    runs = np.geomspace(1, 1e5, 101)
    for row, dashes in zip(_cheapest(result), DASHES, strict=False):
        full, crossing = result.cheapest_full(row), result.break_even(row) or np.inf
        pays = bool(np.isfinite(crossing))
        for other in (row, full) if full and full != row else (row,):
            axes.loglog(
                runs,
                (0.0 if other.is_full else other.set_up) + runs * other.least,
                linestyle=dashes,
                color=_style(result, other.model)["color"],
                label=f"{other.model}: {other.error:.0e}"
                + f", after {crossing:,.0f} runs" * (pays and other is row),
            )
        if pays:
            axes.plot(crossing, row.set_up + crossing * row.least, "o", color="black", ms=5)
    if axes.lines:
        axes.legend(fontsize=SMALL, loc="lower right")
        axes.set_ylim(axes.get_ylim()[0] / 100)  # room for it
    axes.set(xlabel="runs", ylabel="time, the full model compiled [s]")
    axes.set_title("When reduction pays", fontsize=11)
    axes.grid(color="0.9")
