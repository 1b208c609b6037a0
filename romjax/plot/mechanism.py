"""The mechanism as lines in axes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..scene.scene import Scene
from .geometry import hinges, outlines, rails
from .style import GREY


class Picture:
    """One mechanism in one pair of axes; `show` moves it to another configuration."""

    def __init__(self, axes: Axes, scene: Scene, q: np.ndarray, **look: Any):
        self.outlines = outlines(scene, q)
        self.hinges = hinges(scene, q)
        self.lines = [Line2D([], [], solid_capstyle="round", **look) for _ in self.outlines]
        dots = look | {"linestyle": "none", "marker": "o", "markersize": 4}
        self.dots = Line2D([], [], markerfacecolor="white", **dots)
        for line in (*self.lines, self.dots):
            axes.add_line(line)
        self.show(0)

    def show(self, index: int) -> None:
        """Draw the configuration number `index`."""
        for line, outline in zip(self.lines, self.outlines, strict=True):
            line.set_data(outline[index, :, 0], outline[index, :, 1])
        self.dots.set_data(self.hinges[index, :, 0], self.hinges[index, :, 1])


def bounds(shapes: Sequence[np.ndarray]) -> np.ndarray:
    """Lower and upper corner (2, 2) of all points of the arrays (..., 2), finite ones only."""
    points = np.concatenate([shape.reshape(-1, 2) for shape in shapes])
    points = points[np.all(np.isfinite(points), axis=1)]
    return np.stack([np.min(points, axis=0), np.max(points, axis=0)])


def view(box: np.ndarray) -> np.ndarray:
    """The box (2, 2) with a margin, and never flat."""
    size = float(np.max(box[1] - box[0])) or 1.0
    middle = 0.5 * (box[0] + box[1])
    half = np.maximum(0.5 * (box[1] - box[0]) + 0.06 * size, 0.15 * size)
    return np.stack([middle - half, middle + half])


def stage(axes: Axes, scene: Scene, box: np.ndarray) -> None:
    """Equal scales, the limits of `box`, and the rails on the ground."""
    axes.set_aspect("equal")
    axes.set_xlim(box[0, 0], box[1, 0])
    axes.set_ylim(box[0, 1], box[1, 1])
    for point, angle in rails(scene):
        axes.axline(
            (point[0], point[1]),
            (point[0] + np.cos(angle), point[1] + np.sin(angle)),
            color=GREY,
            linewidth=0.8,
            linestyle="-.",
            zorder=0,
        )
