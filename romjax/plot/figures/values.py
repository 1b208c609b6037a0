"""Singular values and the ranks chosen from them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import MaxNLocator

from ...basis.basis import Basis
from ...common.checks import check_kind
from ..style import COLOURS, DASHES, MARKERS, SMALL, DisplayedFigure

# Decades between two lines whose names do not touch.
_APART = 1.5


def values(*bases: Basis) -> Figure:
    """Singular values relative to the largest, on a logarithmic axis (chapter Fig. 39.3).

    Against the index, a line for each basis: the modes that are kept filled, the ones that are
    dropped hollow, the rank as a vertical line between them. Level lines show what decided it: the
    tolerance, where one was given, and the noise floor, of rounding or of the integration; below
    the lowest floor all is grey, and zeros are drawn at its foot. Values of another kind have a
    panel of their own: the smooth orthogonal values λ [s²] of the kept modes, of SOD bases.

    Raises ValueError without any basis.
    """
    if not bases:
        raise ValueError("values: no basis given; pass some, such as values(romjax.pod(truth)).")
    for basis in bases:
        check_kind("values", "a basis", basis, Basis, "what romjax.pod or romjax.sod returns")
    names = _names(bases)
    made_by = [basis.decomposition for basis in bases]
    labels = [None if made is None else made.value_label for made in made_by]
    kinds = [label for label in dict.fromkeys(labels) if label is not None]
    figure = DisplayedFigure(figsize=(5.5 + 3.0 * len(kinds), 4))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(1, 1 + len(kinds), squeeze=False)[0]
    axes = panels[0]
    # Bases of one's own have no floor.
    floors = [float(basis.floor) for basis in bases]
    floor = min((value for value in floors if value > 0), default=1e-12)
    foot = min(1e-4 * floor, 1e-16)
    lowest = 1.0
    for i, (basis, name) in enumerate(zip(bases, names, strict=True)):
        spectrum = np.asarray(basis.spectrum)
        relative = np.maximum(spectrum / np.max(spectrum), foot)
        lowest = min(lowest, float(np.min(relative)))
        _stems(axes, i, relative, basis.rank, f"{name}, rank {basis.rank}")
        # Shifted a little, so that equal ranks stay two lines.
        across = basis.rank + 0.5 + 0.06 * (i - 0.5 * (len(bases) - 1))
        axes.axvline(across, color=_colour(i), linestyle=DASHES[(i + 1) % len(DASHES)], linewidth=1)
        whose = f" of {name}" if len(bases) > 1 else ""
        if float(basis.floor) > 0:
            _level(axes, i, float(basis.floor), f"noise floor{whose}", ":", "top")
        if basis.tol is not None:
            _level(axes, i, float(basis.tol), f"tolerance{whose}", "-.", "bottom")
    _dress(axes, "index $i$", r"singular value $\sigma_i / \sigma_1$", "Singular values")
    axes.set_ylim(top=4)
    bottom = min(lowest, floor) / 4
    axes.axhspan(bottom, floor, color="0.92", zorder=0)
    axes.set_ylim(bottom=bottom)
    for panel, kind in zip(panels[1:], kinds, strict=True):
        for i in (i for i, label in enumerate(labels) if label == kind):
            heights = np.asarray(bases[i].values)
            least = max(float(np.max(heights)) * foot, np.finfo(float).tiny)
            _stems(panel, i, np.maximum(heights, least), len(heights), names[i])
        _dress(panel, "mode $i$", f"${kind.symbol}_i$ [{kind.unit}]", kind.title)
    return figure


def _colour(index: int) -> str:
    return COLOURS[(index + 1) % len(COLOURS)]


def _level(axes: Axes, index: int, height: float, text: str, dashes: str, va: str) -> None:
    """A level line of a basis, named above or below; names of lines at one height stand side by
    side.
    """
    colour = _colour(index)
    named = [other.xy[1] for other in axes.texts if isinstance(other, Annotation)]
    beside = sum(1 for other in named if abs(np.log10(other / height)) < _APART)
    axes.axhline(height, color=colour, linestyle=dashes, linewidth=1)
    axes.annotate(
        text,
        (0.02 + 0.32 * beside, height),
        xycoords=axes.get_yaxis_transform(),
        color=colour,
        va=va,
        fontsize=SMALL,
    )


def _stems(axes: Axes, index: int, heights: np.ndarray, rank: int, name: str) -> None:
    """One line over 1, 2, …; filled markers up to `rank`, hollow ones beyond."""
    number = np.arange(1, len(heights) + 1)
    style: dict[str, Any] = {"color": _colour(index), "marker": MARKERS[(index + 1) % len(MARKERS)]}
    style["markersize"] = max(3.5, 8 - 2 * index)  # the first still shows behind the next
    dashes = DASHES[(index + 1) % len(DASHES)]
    axes.plot(number[:rank], heights[:rank], linestyle=dashes, label=name, **style)
    dropped = slice(rank - 1, None)
    axes.plot(
        number[dropped], heights[dropped], linestyle=dashes, linewidth=0.8, color=style["color"]
    )
    hollow = {**style, "linestyle": "none", "markerfacecolor": "white"}
    axes.plot(number[rank:], heights[rank:], **hollow)


def _dress(axes: Axes, across: str, up: str, title: str) -> None:
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.set_title(title, fontsize=11)
    axes.grid(color="0.85")
    axes.legend(fontsize=SMALL + 1)


def _names(bases: Sequence[Basis]) -> list[str]:
    kinds = [basis.name for basis in bases]
    return [
        kind if kinds.count(kind) == 1 else f"{kind} {kinds[: i + 1].count(kind)}"
        for i, kind in enumerate(kinds)
    ]
