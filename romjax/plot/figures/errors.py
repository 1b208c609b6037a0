"""Errors over time."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ...common.checks import check_kind
from ...integrate.trajectory import Trajectory
from ...study.compare import compare
from ..choice import choose
from ..panels import check_coordinates, check_same_times, finish, grid
from ..style import line, marks, symbol

DECADES = 8  # shown below the largest error; a zero crossing reaches further and says nothing


def errors(
    truth: Trajectory,
    approx: Mapping[str, Trajectory],
    *,
    coordinates: Sequence[str] | None = None,
) -> Figure:
    """|e_i(t)| of equation 39.17 on a logarithmic axis (chapter Fig. 39.5).

    One panel per coordinate, one line per model; a number without unit, relative to the largest
    excursion of the coordinate. The legend tells the error of the whole motion in the energy norm.

    **Arguments:**

    - `truth`: a motion with q (k, n). `approx`: motions at the same times, by name.
    - `coordinates`: as for `romjax.plot.response`.

    Raises ValueError if times or coordinates do not fit.
    """
    remedy = "motions by name, {'name': trajectory}"
    check_kind("errors", "approx", approx, Mapping, remedy)
    if not approx:
        raise ValueError("errors: there are no motions to compare; give {'name': trajectory}.")
    for name, motion in approx.items():
        check_coordinates("errors", truth, name, motion)
        check_same_times("errors", truth, name, motion)
    comparisons = {name: compare(truth, motion) for name, motion in approx.items()}
    columns, note = choose("errors", truth, coordinates)
    figure, panels = grid(len(columns))
    for axes, column in zip(panels, columns, strict=True):
        top, bottom = 0.0, np.inf
        for index, (name, comparison) in enumerate(comparisons.items(), start=1):
            size = np.abs(np.asarray(comparison.history[:, column]))
            shown = np.where(size > 0, size, np.nan)  # a logarithmic axis has no zero
            label = f"{name}: {float(comparison.error):.1e}"
            style = line(index) | marks(index, len(comparisons) + 1, len(size))
            axes.plot(np.asarray(truth.t), shown, label=label, **style)
            if np.isfinite(shown).any():
                top, bottom = max(top, np.nanmax(shown)), min(bottom, np.nanmin(shown))
        axes.set_yscale("log")
        if bottom < top:
            axes.set_ylim(max(bottom, top * 10.0**-DECADES) / 2, top * 3)
        axes.set_ylabel(f"$|e|$ of\n{symbol(truth.coordinates[column])}", multialignment="center")
    finish(
        figure,
        panels,
        r"Relative errors $|e_i(t)|$",
        note,
        "error of the motion in the energy norm",
    )
    return figure
