"""Coordinates over time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...integrate.trajectory import Trajectory
from ..choice import choose
from ..panels import check_coordinates, check_motion, finish, grid
from ..style import line, marks, symbol, unit

# Opacity of bands.
_BAND = 0.25


def response(
    truth: Trajectory,
    *approx: Trajectory,
    coordinates: Sequence[str] | None = None,
    labels: Sequence[str] | None = None,
) -> Figure:
    """Coordinates over time: the truth solid, approximations dashed over it (chapter Fig. 39.4).

    One panel per coordinate; x and y in m, φ in rad, modal amplitudes in kg^½ m.

    **Arguments:**

    - `truth`, `approx`: motions with q (k, n), of the same coordinates; times may differ. Of a
      truth that is a run of `corrected`, its distance from approximations at the same times is
      drawn as a band about these.
    - `coordinates`: labels of the coordinates to draw, such as ["cart.x"]. Without it, those that
      move; of more than eight, the eight that move most in the mass metric.
    - `labels`: names of the motions, that of the truth first.

    Raises ValueError if coordinates or names do not fit.
    """
    check_motion("response: the truth", truth)
    motions = (truth, *approx)
    names = _default(truth, len(approx)) if labels is None else [str(name) for name in labels]
    if len(names) != len(motions):
        raise ValueError(
            f"response: {len(names)} labels for {len(motions)} motions; give one for each, that "
            "of the truth first."
        )
    for name, motion in zip(names[1:], approx, strict=True):
        check_coordinates("response", truth, name, motion)
    columns, note = choose("response", truth, coordinates)
    figure, panels = grid(len(columns))
    for axes, column in zip(panels, columns, strict=True):
        for index, (name, motion) in enumerate(zip(names, motions, strict=True)):
            style = line(index) | marks(index, len(motions), len(motion.t))
            t, q = np.asarray(motion.t), np.asarray(motion.q)[:, column]
            axes.plot(t, q, label=name, **style)
            if index and truth.bar is not None and np.array_equal(truth.t, t):
                bar = np.abs(np.asarray(truth.q)[:, column] - q)
                axes.fill_between(t, q - bar, q + bar, color=style["color"], alpha=_BAND, lw=0)
        coordinate = truth.coordinates[column]
        name = symbol(coordinate, separator="\n")
        axes.set_ylabel(f"{name} {unit(coordinate)}".strip(), multialignment="center")
    finish(figure, panels, "Response", note)
    return figure


def _default(truth: Trajectory, count: int) -> list[str]:
    numbers = [""] if count == 1 else [f" {i + 1}" for i in range(count)]
    return [
        "truth" if truth.bar is None else "corrected",
        *(f"approximation{number}" for number in numbers),
    ]
