"""What reductions of a mechanism pay."""

from collections.abc import Sequence

import numpy as np

from ...trials.result import Reductions
from ...trials.row import ReductionRow
from ..labels import Label, place
from ..style import DisplayedFigure
from .reduction import Point, blank, draw, explain, frame, ring


def reductions(result: Reductions) -> DisplayedFigure:
    """Error against time of the models that were tried, one colour for each kind.

    Filled points are the largest error on starts or speeds that the model has not seen, hollow ones
    that of its training; a vertical line joins the two, a long one of a model that only repeats
    what it has seen. The ring is around the recommended one, squares are around the drop points:
    the models of least rank of each kind whose error is below the one that was asked for, the
    dotted line. The dashed line is the time of the full model. Models that fail are left out.

    **Arguments:** `result`: what `romjax.reductions` has found.
    """
    figure, axes = blank()
    labels, drops = list[Label](), False
    for index, kind in enumerate(dict.fromkeys(row.formulation for row in result.rows), start=1):
        rows = [r for r in result.rows if r.formulation == kind and np.isfinite(r.error)]
        rows.sort(key=lambda row: row.time)
        words = [row.name.removeprefix(kind).strip() for row in rows]
        pairs = zip(rows, words, strict=True)
        points = [Point(row.time, row.trained, row.error, said) for row, said in pairs]
        if points:
            labels += draw(axes, index, kind, points, apart=True)
        if drop := _drop(rows, result.tol):
            frame(axes, index, drop.time, drop.error)
            drops = True
        if result.recommended in rows:
            ring(axes, index, result.rows[0].time, result.rows[0].error)
    axes.axhline(result.tol, color="black", linestyle=":", linewidth=1)
    axes.plot([], [], ":", color="black", label=f"error asked for, {result.tol:g}")
    if drops:
        axes.plot(
            [], [], "s", ms=10, mfc="none", mec="0.3", label="drop point: least rank below it"
        )
    explain(figure, axes, result.full.time, result.unseen, "recommended")
    place(figure, axes, labels)
    return figure


def _drop(rows: Sequence[ReductionRow], tol: float) -> ReductionRow | None:
    """The model of least rank that is right, of equal ones the fastest."""
    right = [row for row in rows if row.error <= tol]
    return min(right, key=lambda row: (row.rank, row.time), default=None)
