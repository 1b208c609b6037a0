"""Modes as shapes of the mechanism."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from ...assembly.outlines import outlines
from ...basis.basis import Basis
from ...common.checks import check_kind
from ...scene.coordinate import Coordinate
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..mechanism import Picture, bounds, framed, projected, stage
from ..palette import VIEW, View
from ..shapes import amplitudes
from ..style import COLOURS, GREY, SMALL, DisplayedFigure, symbol, width

MOST = 8  # modes
ROWS = 24  # of the table
NEGLIGIBLE = 1e-9  # component, relative to the largest of its mode


def modes(
    scene: Scene, basis: Basis, system: AbstractSystem | None = None, *, view: View = VIEW
) -> Figure:
    """Each mode as a shape of the mechanism, over a table of its components (table 39.1).

    The mechanism at rest in grey, without loads, and displaced by the mode in colour, so far that
    the point that moves most moves by 15 % of the mechanism's size; hinges that a mode tears apart
    have two dots. The table has a row for each coordinate of a body and a column for each mode; it
    is left out for more than 24 of these, as are modes after the eighth. The components have the
    units of the coordinates over kg^½ m, the modes being orthonormal in the mass metric.

    **Arguments:**

    - `scene`, `basis`: modes (n, r) of that scene.
    - `system`: its start q0 (n,) is the configuration at rest, instead of the offset of the basis.
    - `view`: azimuth against the x axis and elevation of a view of space [rad].

    Raises ValueError if scene and basis do not fit.
    """
    check_kind("modes", "the scene", scene, Scene, "a romjax.Scene")
    check_kind("modes", "the basis", basis, Basis, "what romjax.pod or romjax.sod returns")
    vectors = np.asarray(basis.modes)
    reference = np.asarray(basis.offset if system is None else system.q0)
    if reference.shape != vectors.shape[:1]:
        raise ValueError(
            f"modes: the configuration at rest has shape {reference.shape}, but the modes have "
            f"shape {vectors.shape}; give the full system that the basis was made from."
        )
    r = min(basis.rank, MOST)
    sizes = amplitudes(scene, 0.0, reference, vectors[:, :r])
    drawn = outlines(
        scene, 0.0, np.stack([reference, *(reference[:, None] + sizes * vectors[:, :r]).T])
    )
    drawn = projected([outline for outline in drawn if outline.style != "load"], view)  # no time
    frame = framed(bounds(drawn))
    wide, height = frame[1] - frame[0]
    thick = width(2.2, scene.dimension)

    # There are as many pictures side by side as suit their shape.
    columns = min(r, 6 if height > 1.3 * wide else 4 if height > 0.5 * wide else 2)
    rows = -(-r // columns)
    across = 9.0
    tall = rows * (min(across / columns * height / wide, 4.0) + 0.5)
    # States of effects and counters of turns, which stand behind these, have no shapes.
    coordinates = [c for body in scene.bodies for c in body.coordinates()]
    n = len(coordinates)
    low = 0.3 + 0.2 * (n + 1) if n <= ROWS else 0.0
    figure = DisplayedFigure(figsize=(across, tall + low + 0.5))
    figure.set_layout_engine("constrained")
    parts = figure.add_gridspec(2 if low else 1, 1, height_ratios=[tall, low] if low else [tall])
    pictures = parts[0].subgridspec(rows, columns)
    for j in range(r):
        axes = figure.add_subplot(pictures[j // columns, j % columns])
        stage(axes, frame)
        Picture(axes, drawn, color=GREY, linewidth=thick)
        Picture(axes, drawn, details=False, color=COLOURS[5], linewidth=0.7 * thick).show(j + 1)
        axes.set_axis_off()
        axes.set_title(_title(basis, j), fontsize=SMALL + 1)
    if low:
        _table(figure.add_subplot(parts[1]), basis, coordinates)
    title = "Modes" if basis.decomposition is None else f"{basis.name} modes"
    title += f" (first {r} of {basis.rank})" if r < basis.rank else ""
    figure.suptitle(title, fontsize=11)
    return figure


def _title(basis: Basis, j: int) -> str:
    values = np.asarray(basis.values)
    if basis.decomposition is None:
        return f"mode {j + 1}"
    label = basis.decomposition.value_label
    if label is None:  # the singular values that decided the rank
        share = values[j] / values[0]
        return f"mode {j + 1}\n$\\sigma/\\sigma_1$ = {share:.2g}"
    return f"mode {j + 1}\n${label.symbol}$ = {values[j]:.2g} {label.unit}"


def _table(axes: Axes, basis: Basis, coordinates: list[Coordinate]) -> None:
    """The components; what is rounding beside the largest of the mode is printed as 0."""
    axes.set_axis_off()
    vectors = np.asarray(basis.modes)[: len(coordinates), :MOST]
    small = NEGLIGIBLE * np.max(np.abs(vectors), axis=0)
    cells = [
        ["0" if abs(x) <= least else f"{x:.3g}" for x, least in zip(row, small, strict=True)]
        for row in vectors
    ]
    table = axes.table(
        cells,
        rowLabels=[symbol(coordinate) for coordinate in coordinates],
        colLabels=[f"mode {j + 1}" for j in range(vectors.shape[1])],
        bbox=Bbox.from_bounds(0.14, 0.0, 0.86, 1.0),
        cellLoc="center",
        edges="horizontal",
    )
    for cell in table.get_celld().values():
        cell.set_edgecolor(GREY)
        cell.set_linewidth(0.5)
    table.auto_set_font_size(False)
    table.set_fontsize(SMALL)
