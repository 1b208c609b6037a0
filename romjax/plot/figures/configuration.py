"""Figure of a mechanism at one position."""

from typing import Any, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...assembly.outlines import outlines
from ...common.checks import check_finite, check_kind
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..mechanism import Picture, bounds, framed, projected, stage
from ..palette import VIEW, View
from ..style import COLOURS, DisplayedFigure, width


def configuration(
    mechanism: Scene | AbstractSystem,
    q: Float[Array | np.ndarray, " n"] | None = None,
    *,
    axes: Axes | None = None,
    view: View = VIEW,
    **body: Any,
) -> Figure:
    """The mechanism at one position, with its joints, springs and loads at t = 0.

    Nothing is exaggerated, and joints need not hold: where they do not, a hinge has two dots.

    **Arguments:**

    - `mechanism`: a scene, or a system, full or reduced, that was assembled from one.
    - `q`: coordinates of the bodies, (n,); the start unless given.
    - `axes`: of matplotlib, that are drawn into; a figure of its own unless given.
    - `view`: azimuth against the x axis and elevation of a view of space [rad].
    - `body`: how matplotlib draws the lines of bodies, such as `color`.

    Raises InputError for what is no mechanism, and for a q that is not finite; ValueError for a q
    of another length.
    """
    if not isinstance(mechanism, Scene):
        remedy = "a Scene, or a system that was assembled from one"
        check_kind("configuration", "the mechanism", mechanism, AbstractSystem, remedy)
        mechanism = disassemble(assembled("configuration", mechanism))
    mechanism.check()
    if q is None:
        q = jnp.concatenate([part.start()[0] for part in mechanism.bodies])
    check_finite("configuration", "q", q)
    drawn = projected(outlines(mechanism, 0.0, jnp.asarray(q)[None]), view)
    box = framed(bounds(drawn))
    if axes is None:
        across, up = box[1] - box[0]
        tall = float(np.clip(6.0 * up / across, 2.0, 6.0))
        figure = DisplayedFigure(figsize=(max(tall * across / up, 3.0), tall))
        figure.set_layout_engine("constrained")
        axes = figure.add_subplot()
    stage(axes, box, view if mechanism.dimension == 3 else None)
    thick = width(2.0, mechanism.dimension)
    Picture(axes, drawn, **{"color": COLOURS[0], "linewidth": thick, **body})
    axes.set_axis_off()
    return cast(Figure, axes.figure)
