"""The style of all figures: colours, line styles, and names with units."""

import io
import re
from typing import Any

from matplotlib.figure import Figure

from ..scene.coordinate import Coordinate
from ..scene.outline import Style
from .palette import COLOURS as COLOURS
from .palette import STROKES, WIDTHS

DASHES: tuple[Any, ...] = tuple((0, strokes) if strokes else "-" for strokes in STROKES)
MARKERS = ("", "o", "s", "^", "D", "v", "P")
GREY = "0.6"

SMALL = 8  # [pt] notes, legends and tables

# The style of outlines, by what they stand for; bodies and marks take the colour of their model.
# Everything else is grey, so that bodies stand out, and is drawn for the first model only.
LINES: dict[Style, dict[str, Any]] = {
    "link": {"color": "0.25", "linewidth": 1.0},
    "track": {"color": GREY, "linewidth": 0.8, "linestyle": "-.", "zorder": 0.5},
    "spring": {"color": "0.4", "linewidth": 0.9, "zorder": 1.5},
    "damper": {"color": "0.4", "linewidth": 0.9, "zorder": 1.5},
    "load": {"color": "0.25", "linewidth": 1.1, "zorder": 3},
    "surface": {"color": GREY, "linewidth": 1.6, "zorder": 0.5},
    "ground": {"color": GREY, "linewidth": 0.8, "zorder": 0.5},
}
TRACE: dict[str, Any] = {"linewidth": 0.8, "alpha": 0.6, "zorder": 1}
SIGNS: dict[Style, dict[str, Any]] = {
    "hinge": {"marker": "o", "markersize": 4.5, "markerfacecolor": "white"},
    "weld": {"marker": "s", "markersize": 4.5},
    "point": {"marker": "o", "markersize": 2.5},
}


class DisplayedFigure(Figure):
    """A figure that notebooks show, whether pyplot is in use there or not."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=100)
        return content.getvalue()


def line(index: int, dimension: int = 2) -> dict[str, Any]:
    """Colour, dashes and width of the model number `index`; 0 is the reference, a wide solid line.

    `dimension`: of the mechanism, where lines are those of its bodies.
    """
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": DASHES[index % len(DASHES)],
        "linewidth": width(WIDTHS[index > 0], dimension),
    }


def width(points: float, dimension: int) -> float:
    """The width of lines of bodies [pt]: in space half, where they are the edges of boxes."""
    return points if dimension == 2 else 0.5 * points


def marks(index: int, models: int, points: int) -> dict[str, Any]:
    """Sparse markers, staggered between the models, so that even coincident lines differ."""
    step = max(1, points // 8)
    return {
        "marker": MARKERS[index % len(MARKERS)],
        "markevery": ((index * step) // models, step),
        "markersize": 4,
        "markerfacecolor": "white",
    }


def symbol(coordinate: Coordinate, separator: str = " ") -> str:
    """A coordinate as one prints it: `beam.q1` becomes 'beam q₁' in mathematical type.

    `separator` stands between the name of the body and the symbol.
    """
    sign = f"${coordinate.symbol}$" if coordinate.symbol else _plain(coordinate.name)
    return f"{_plain(coordinate.owner)}{separator}{sign}" if coordinate.owner else sign


def unit(coordinate: Coordinate) -> str:
    """The unit of a coordinate in brackets; nothing for coordinates of unknown meaning."""
    if not coordinate.unit:
        return ""
    return "[" + re.sub(r"\^([-\d/]+)", r"$^{\1}$", coordinate.unit) + "]"


def _plain(text: str) -> str:
    return text.replace("$", r"\$")
