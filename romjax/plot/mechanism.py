"""The mechanism as lines in axes; in space as it is seen from one side."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from ..assembly.outlines import MovingOutline
from ..scene.outline import Style
from .palette import VIEW, View
from .style import GREY, LINES, SIGNS, SMALL, TRACE

# At how many points of a line, and in how many frames about, is looked where a corner is free.
_PIECES, _FRAMES = 16, 24


def projected(outlines: Sequence[MovingOutline], view: View = VIEW) -> list[MovingOutline]:
    """Outlines in the plane of the picture, (frames, points, 2): those of space as they are seen
    from far away, those of the plane as they are.
    """
    if outlines[0].points.shape[2] == 2:
        return list(outlines)
    return [outline._replace(points=outline.points @ picture_axes(view).T) for outline in outlines]


def picture_axes(view: View) -> np.ndarray:
    """The directions in space that are to the right and up in the picture, (2, 3)."""
    (sin, low), (cos, flat) = np.sin(view), np.cos(view)
    return np.array([(-sin, cos, 0.0), (-low * cos, -low * sin, flat)])


class Picture:
    """One mechanism in one pair of axes; `show` moves it to another configuration.

    There is one line in the axes for each style of outline, whatever their number. `body` is the
    style of the bodies; without `details` only these and the marks of joints are drawn. Bodies with
    values have them in colour over it, by `colours`.
    """

    def __init__(
        self, axes: Axes, outlines: Sequence[MovingOutline], *, details: bool = True, **body: Any
    ):
        settings: dict[Style, dict[str, Any]] = {"body": {"solid_capstyle": "round", **body}}
        if details:
            settings |= {style: dict(own) for style, own in LINES.items()}
        for style, own in SIGNS.items():
            settings[style] = {
                "color": body.get("color"),
                "linestyle": "none",
                "zorder": 2.5,
                **own,
            }
        settings["trace"] = {"color": body.get("color"), **TRACE}
        self.coloured = [o for o in outlines if o.values is not None]
        self.colours: LineCollection | None = None
        if self.coloured:
            self.colours = LineCollection([], cmap="coolwarm", linewidths=5.0, zorder=2.2)
            self.colours.set_capstyle("round")  # without seams between the pieces
            axes.add_collection(self.colours)
        self.points: dict[Style, np.ndarray] = {}
        self.lines: dict[Style, Line2D] = {}
        for style, own in settings.items():
            parts = [_shown(outline) for outline in outlines if outline.style == style]
            if parts:
                self.points[style] = _joined(parts)
                self.lines[style] = axes.add_line(Line2D([], [], **own))
        self.show(0)

    def show(self, index: int) -> None:
        """Draw the configuration number `index`."""
        for style, line in self.lines.items():
            line.set_data(*self.points[style][index].T)
        if self.colours is not None:
            paths = [o.points[index] for o in self.coloured]
            values = [o.values[index] for o in self.coloured if o.values is not None]
            self.colours.set_segments(
                [*np.concatenate([np.stack([x[:-1], x[1:]], axis=1) for x in paths])]
            )
            self.colours.set_array(np.concatenate([(x[:-1] + x[1:]) / 2 for x in values]))

    @property
    def artists(self) -> list[Artist]:
        """All that moves."""
        return [*self.lines.values(), *([] if self.colours is None else [self.colours])]


def _shown(outline: MovingOutline) -> np.ndarray:
    """Return the points of an outline in each frame; a trace shows those of all frames at once."""
    if outline.style != "trace":
        return outline.points
    path = outline.points[:, 0]
    return np.broadcast_to(path[None], (len(path), *path.shape))


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Polylines (frames, points, 2) as one, with a gap after each."""
    # One line for all outlines of a style, broken by NaN, draws several times as fast as a line
    # each.
    gap = np.full((len(parts[0]), 1, 2), np.nan)
    return np.concatenate([piece for part in parts for piece in (part, gap)], axis=1)


def bounds(outlines: Sequence[MovingOutline]) -> np.ndarray:
    """Lower and upper corner (2, 2) of all that is finite."""
    points = np.concatenate([o.points.reshape(-1, 2) for o in outlines if not o.endless])
    points = points[np.all(np.isfinite(points), axis=1)]
    return np.stack([np.min(points, axis=0), np.max(points, axis=0)])


def framed(box: np.ndarray) -> np.ndarray:
    """The box (2, 2) with a margin, and never flat."""
    size = float(np.max(box[1] - box[0])) or 1.0
    middle = 0.5 * (box[0] + box[1])
    # A margin of 6 %, and no side narrower than 30 % of the other: motions along a line stay
    # visible.
    half = np.maximum(0.5 * (box[1] - box[0]) + 0.06 * size, 0.15 * size)
    return np.stack([middle - half, middle + half])


def stage(
    axes: Axes,
    box: np.ndarray,
    view: View | None = None,
    drawn: Sequence[MovingOutline] = (),
) -> None:
    """Equal scales, and the limits of `box`; for a `view` of space no scales, since no axis is in
    the picture, but where x, y and z point, in a corner that is free of what is `drawn`.
    """
    axes.set_aspect("equal")
    axes.set_xlim(box[0, 0], box[1, 0])
    axes.set_ylim(box[0, 1], box[1, 1])
    if view is None:
        return
    # In space the axes in the corner stand for the frame, whose numbers would be those of no
    # direction.
    axes.set_axis_off()
    length = 0.06 * float(np.max(box[1] - box[0]))
    right, above = _corner(box, 3.2 * length, drawn)
    foot = np.array([box[right, 0], box[above, 1]])
    foot += 1.6 * length * np.array([1 - 2 * right, 1 - 2 * above])
    for name, way in zip("xyz", picture_axes(view).T, strict=True):
        tip = foot + length * way
        axes.plot(*np.stack([foot, tip], axis=1), color=GREY, linewidth=0.8)
        x, y = foot + 1.4 * length * way
        axes.text(x, y, name, color=GREY, ha="center", va="center", fontsize=SMALL)


def _corner(
    box: np.ndarray, side: float, drawn: Sequence[MovingOutline]
) -> tuple[Literal[0, 1], Literal[0, 1]]:
    """Whether it is right, and whether it is above: the lower left corner of a box, or the first
    other one with less drawn in a square of that `side` there.
    """
    lines = [_along(outline.points) for outline in drawn if not outline.endless]

    def crowded(place: tuple[Literal[0, 1], Literal[0, 1]]) -> int:
        corner = np.array([box[place[0], 0], box[place[1], 1]])
        return sum(int(np.sum(np.all(np.abs(x - corner) < side, axis=-1))) for x in lines)

    places: list[tuple[Literal[0, 1], Literal[0, 1]]] = [(0, 0), (1, 0), (0, 1), (1, 1)]
    return min(places, key=crowded)


def _along(points: np.ndarray) -> np.ndarray:
    """Points all along lines (frames, points, 2), in some of the frames."""
    some = points[:: max(1, len(points) // _FRAMES)]
    shares = np.linspace(0.0, 1.0, _PIECES)[:, None, None, None]
    return some[:, :-1] * (1 - shares) + some[:, 1:] * shares
