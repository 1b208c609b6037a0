"""Figure of the gain by reductions of a mechanism."""

from collections.abc import Sequence

import numpy as np

from ...common.checks import check_kind
from ...trials.result import Reductions
from ...trials.row import ReductionRow
from ..labels import Label, place
from ..style import DisplayedFigure
from .reduction import Point, blank, draw, explain, frame, hollow, ring

# The errors that are shown where there is none, relative to the one that is asked for.
_AROUND = 0.1, 10.0
# Times are shown beyond the shortest and the longest by this factor.
_BESIDE = 1.3


def reductions(result: Reductions) -> DisplayedFigure:
    """Error against time of the models that were tried, one colour for each kind.

    Filled points are the largest error on starts or speeds that the model has not seen, hollow ones
    that of its training; a vertical line joins the two, a long one of a model that only repeats
    what it has seen. The ring is around the recommended one, squares are around the drop points:
    the models of least rank of each kind, if it was tried at several, whose error is below the one
    that was asked for, the dotted line. The dashed line is the time of the full model. Models that
    fail unseen, or were not run from there, have a hollow point only, and those that fail on their
    training none.

    **Arguments:** `result`: what `romjax.reductions` has found.
    """
    check_kind("reductions", "the result", result, Reductions, "what romjax.reductions returns")
    figure, axes = blank()
    # The limits are set here: those of one point alone are equal for a moment, of which matplotlib
    # warns.
    times = [1e3 * row.time for row in (result.full, *result.rows)]
    axes.set_xlim(min(times) / _BESIDE, max(times) * _BESIDE)
    labels, drops = list[Label](), False
    for index, kind in enumerate(dict.fromkeys(row.formulation for row in result.rows), start=1):
        own = [r for r in result.rows if r.formulation == kind and np.isfinite(r.trained)]
        own.sort(key=lambda row: row.time)
        rows = [row for row in own if np.isfinite(row.error)]
        points = [_point(row, result.unseen) for row in rows]
        if points:
            labels += draw(axes, index, kind, points, apart=True)
        failed = [row for row in own if row not in rows]
        labels += [hollow(axes, index, 1e3 * row.time, row.trained, row.name) for row in failed]
        if drop := _drop(rows, result.tol):
            frame(axes, index, drop.time, drop.error)
            drops = True
        if result.recommended in rows:
            ring(axes, index, result.rows[0].time, result.rows[0].error)
    if not labels:
        # A logarithmic axis with one line on it has no limits of its own.
        axes.set_ylim(_AROUND[0] * result.tol, _AROUND[1] * result.tol)
    axes.axhline(result.tol, color="black", linestyle=":", linewidth=1)
    axes.plot([], [], ":", color="black", label=f"error asked for, {result.tol:g}")
    if drops:
        axes.plot(
            [], [], "s", ms=10, mfc="none", mec="0.3", label="drop point: least rank below it"
        )
    explain(figure, axes, result.full.time, result.unseen, "recommended")
    place(figure, axes, labels)
    return figure


def _point(row: ReductionRow, unseen: int) -> Point:
    """A model by its time; where there are no `unseen` runs, all are judged by their training."""
    words = row.name.removeprefix(row.formulation).strip()
    return Point(row.time, row.trained, row.error, words, not (unseen and np.isnan(row.unseen)))


def _drop(rows: Sequence[ReductionRow], tol: float) -> ReductionRow | None:
    """The model of least rank that is right, of equal ones the fastest; None of one rank alone."""
    if len({row.rank for row in rows}) < 2:
        return None
    right = [row for row in rows if row.error <= tol]
    return min(right, key=lambda row: (row.rank, row.time), default=None)
