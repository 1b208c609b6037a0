"""What reductions of a mechanism pay."""

import numpy as np

from ...trials.result import Reductions
from ..style import DisplayedFigure
from .reduction import Point, blank, draw, explain, ring


def reductions(result: Reductions) -> DisplayedFigure:
    """Error against time of the models that were tried, one colour for each kind.

    Filled points are the largest error on starts or speeds that the model has not seen, hollow ones
    that of its training; a vertical line joins the two, a long one of a model that only repeats
    what it has seen. The ring is around the recommended one, the dashed line is the time of the
    full model. Models that fail are left out.

    **Arguments:** `result`: what `romjax.reductions` has found.
    """
    figure, axes = blank()
    for index, kind in enumerate(dict.fromkeys(row.formulation for row in result.rows), start=1):
        rows = [r for r in result.rows if r.formulation == kind and np.isfinite(r.error)]
        rows.sort(key=lambda row: row.time)
        words = [row.name.removeprefix(kind).strip() for row in rows]
        pairs = zip(rows, words, strict=True)
        points = [Point(row.time, row.trained, row.error, said) for row, said in pairs]
        if points:
            draw(axes, index, kind, points, apart=True)
        if result.recommended in rows:
            ring(axes, index, result.rows[0].time, result.rows[0].error)
    explain(figure, axes, result.full.time, result.unseen, "recommended")
    return figure
