"""Times at equal errors, and the work–precision diagram."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

STYLES = {
    "Rodas5P": ("#0072b2", "o-"),
    "Dopri8": ("#0072b2", "^--"),
    "Dopri8, fixed steps": ("#56b4e9", "^-"),
    "Tsit5": ("#009e73", "v-."),
    "Kvaerno5": ("#d55e00", "s-"),
    "SciPy BDF": ("#7f7f7f", "x--"),
    "SciPy LSODA": ("#7f7f7f", "+:"),
    "MuJoCo": ("#000000", "d-"),
    "Exudyn": ("#cc79a7", "P-"),
}


class Row(NamedTuple):
    """One method at one setting."""

    method: str
    setting: float
    error: float
    least_ms: float
    median_ms: float
    first_s: float  # first call of the method: trace, compile and run
    steps: int


def at_error(points: Sequence[tuple[float, float]], error: float) -> float | None:
    """Least time at an error, of pairs of error and time, along straight lines between neighbours
    in the logarithms. None where no run is that good.
    """
    points = sorted(point for point in points if 0 < point[0] < 1)
    if not points or error < points[0][0]:
        return None
    errors, times = np.log(points).T
    # Looser than the loosest run: that one, as it is.
    return float(np.exp(np.interp(np.log(error), errors, times)))


def at_equal_error(rows: Sequence[Row], error: float) -> dict[str, float]:
    """Time [ms] of each method that comes to an error."""
    found = {
        method: at_error([(row.error, row.least_ms) for row in rows if row.method == method], error)
        for method in STYLES
    }
    return {method: taken for method, taken in found.items() if taken}


def draw(cases: dict[str, list[Row]]) -> Figure:
    """The work–precision diagram, one panel per case."""
    columns = min(4, len(cases))
    lines = -(-len(cases) // columns)
    figure = Figure(figsize=(3.1 * columns, 3.0 * lines + 0.7))
    shared = {}
    for k, (name, rows) in enumerate(cases.items()):
        axes = figure.add_subplot(lines, columns, k + 1, title=name)
        for method, (colour, style) in STYLES.items():
            points = [(row.error, row.least_ms) for row in rows if row.method == method]
            points = sorted(point for point in points if 0 < point[0] < 1)
            if points:
                (shared[method],) = axes.loglog(
                    *np.transpose(points), style, color=colour, markersize=4, linewidth=1.2
                )
        axes.set_xlim(1e-9, 1e-2)
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
        axes.set_xlabel("error")
        if k % columns == 0:
            axes.set_ylabel("time [ms]")
    figure.legend(shared.values(), shared.keys(), loc="lower center", ncols=5, frameon=False)
    figure.tight_layout(rect=(0, 0.09, 1, 1))
    return figure
