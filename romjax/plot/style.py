"""How all figures look: colours, line styles, and names with units."""

import io
import re
from typing import Any

from matplotlib.figure import Figure

# Okabe and Ito's palette, which colour-blind readers can tell apart; the reference in black, then
# in an order that alternates dark and light, for print in grey.
COLOURS = ("#000000", "#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#E69F00")
DASHES = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (7, 2, 1.5, 2)), (0, (3, 3)), (0, (9, 3)), "-.")
MARKERS = ("", "o", "s", "^", "D", "v", "P")
GREY = "0.6"

SMALL = 8  # [pt] notes, legends and tables
UNITS = {"x": "m", "y": "m", "phi": "rad"}


class DisplayedFigure(Figure):
    """A figure that notebooks show, whether pyplot is in use there or not."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=100)
        return content.getvalue()


def line(index: int) -> dict[str, Any]:
    """Colour and dashes of the model number `index`; 0 is the reference, a wide solid line."""
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": DASHES[index % len(DASHES)],
        "linewidth": 1.4 if index else 2.0,
    }


def marks(index: int, models: int, points: int) -> dict[str, Any]:
    """Sparse markers, staggered between the models, so that even lines in one place differ."""
    step = max(1, points // 8)
    return {
        "marker": MARKERS[index % len(MARKERS)],
        "markevery": ((index * step) // models, step),
        "markersize": 4,
        "markerfacecolor": "white",
    }


def symbol(label: str, separator: str = " ") -> str:
    """A coordinate's label as one prints it: `beam.q1` becomes 'beam q₁' in mathematical type.

    `separator` stands between the name of the body and the symbol.
    """
    body, _, name = label.rpartition(".")
    plain = body.replace("$", r"\$")
    if body and name in UNITS:
        return plain + separator + (r"$\varphi$" if name == "phi" else f"${name}$")
    if body and re.fullmatch(r"q\d+", name):
        return f"{plain}{separator}$q_{{{name[1:]}}}$"
    return label.replace("$", r"\$")


def unit(label: str) -> str:
    """The unit of a coordinate in brackets; nothing for coordinates of unknown meaning."""
    body, _, name = label.rpartition(".")
    if body and name in UNITS:
        return f"[{UNITS[name]}]"
    return r"[kg$^{1/2}$ m]" if body and re.fullmatch(r"q\d+", name) else ""
