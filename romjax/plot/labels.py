"""Words beside points, none over another."""

import itertools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from .style import SMALL

# Points that are nearer than this have one label [pt].
_SAME = 6.0
# Distances from a point at which words are tried [pt], and directions, the best first.
_REACHES = (5.0, 14.0, 24.0, 36.0)
_DIRECTIONS = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
_MARK = 3.5  # half the size of a marker [pt]
# Words that stand this far from their point have a line to it [pt].
_FAR = 10.0
# Small words need a darker colour than lines: this share of it.
_INK = 0.65
_ACROSS: dict[int, Literal["left", "center", "right"]] = {1: "left", 0: "center", -1: "right"}
_UP: dict[int, Literal["bottom", "center", "top"]] = {1: "bottom", 0: "center", -1: "top"}


class Label(NamedTuple):
    """Words beside a point of the axes, in its colour; without words, a point that others must not
    cover.
    """

    x: float
    y: float
    words: str
    colour: str


def place(figure: Figure, axes: Axes, labels: Sequence[Label]) -> None:
    """Write labels where they cover neither each other nor a point; those of points that coincide
    in one. Last of all, since other things change where points are.
    """
    figure.draw_without_rendering()
    point = figure.dpi / 72  # [px]
    spots = axes.transData.transform([(label.x, label.y) for label in labels])
    size = _MARK * point
    taken = [Bbox.from_extents(x - size, y - size, x + size, y + size) for x, y in spots]
    written = [label for label in labels if label.words]
    for label in _merged(axes, written, _SAME * point):
        for reach, direction in itertools.product(_REACHES, _DIRECTIONS):
            text = _written(axes, label, reach, direction)
            box = text.get_window_extent()
            if axes.bbox.count_contains(box.corners()) == 4 and not box.count_overlaps(taken):
                taken.append(box)
                break
            text.remove()


def _written(axes: Axes, label: Label, reach: float, direction: tuple[int, int]) -> Annotation:
    """The words so far from their point, with a line where that is far."""
    across, up = direction
    leader = {"arrowstyle": "-", "color": label.colour, "linewidth": 0.5, "alpha": 0.6}
    return axes.annotate(
        label.words,
        (label.x, label.y),
        (reach * across, reach * up),
        textcoords="offset points",
        fontsize=SMALL,
        color=[_INK * part for part in to_rgb(label.colour)],
        horizontalalignment=_ACROSS[across],
        verticalalignment=_UP[up],
        arrowprops=leader if reach > _FAR else None,
    )


def _merged(axes: Axes, labels: Sequence[Label], same: float) -> list[Label]:
    """One label for those whose points are on the same spot [px], black where colours differ."""
    kept = list[Label]()
    for label in labels:
        for number, other in enumerate(kept):
            pair = axes.transData.transform([(label.x, label.y), (other.x, other.y)])
            if np.linalg.norm(pair[0] - pair[1]) < same:
                said = dict.fromkeys([*other.words.split("; "), label.words])
                colour = other.colour if other.colour == label.colour else "black"
                kept[number] = other._replace(words="; ".join(said), colour=colour)
                break
        else:
            kept.append(label)
    return kept
