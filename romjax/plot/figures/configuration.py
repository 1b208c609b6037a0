"""Figure of a mechanism at one position."""

from typing import Any, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...assembly.counting import bodies_coordinates
from ...assembly.disassemble import disassemble
from ...assembly.kinematics import columns_of
from ...assembly.locate import assembled
from ...assembly.outlines import outlines
from ...common.arrays import as_array
from ...common.checks import check_finite, check_kind
from ...common.errors import InputError
from ...compiling.program import program_once
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem, reduced_of
from ..mechanism import Picture, bounds, framed, projected, stage
from ..palette import VIEW, View
from ..style import COLOURS, DisplayedFigure, width


def configuration(
    mechanism: Scene | AbstractSystem,
    q: Float[Array | np.ndarray, " n"] | None = None,
    *,
    t: float = 0.0,
    axes: Axes | None = None,
    view: View = VIEW,
    **body: Any,
) -> Figure:
    """The mechanism at one position, with its joints, springs and loads at one time.

    Nothing is exaggerated, and joints need not hold: where they do not, a hinge has two dots.

    **Arguments:**

    - `mechanism`: a scene, or a system, full or reduced, that was assembled from one.
    - `q`: coordinates of the bodies, (n,), or of a reduced system its own, (r,) with r < n, as an
      equilibrium has them; the start of the scene or the system unless given.
    - `t`: the time [s].
    - `axes`: of matplotlib, that are drawn into; a figure of its own unless given.
    - `view`: azimuth against the x axis and elevation of a view of space [rad].
    - `body`: how matplotlib draws the lines of bodies, such as `color`.

    Raises InputError for what is no mechanism, for `axes` of another kind, and for a q that is no
    coordinates, that has another length, or that is not finite.
    """
    if axes is not None:
        remedy = "axes of matplotlib, such as plt.figure().gca()"
        check_kind("configuration", "axes", axes, Axes, remedy)
    system = None
    if isinstance(mechanism, Scene):
        scene = mechanism
    else:
        remedy = "a Scene, or a system that was assembled from one"
        check_kind("configuration", "the mechanism", mechanism, AbstractSystem, remedy)
        system = mechanism
        scene = disassemble(assembled("configuration", system))
    scene.check()
    drawn = projected(outlines(scene, t, _coordinates(scene, system, q, t)), view)
    box = framed(bounds(drawn))
    if axes is None:
        across, up = box[1] - box[0]
        tall = float(np.clip(6.0 * up / across, 2.0, 6.0))
        figure = DisplayedFigure(figsize=(max(tall * across / up, 3.0), tall))
        figure.set_layout_engine("constrained")
        axes = figure.add_subplot()
    stage(axes, box, view if scene.dimension == 3 else None, drawn)
    thick = width(2.0, scene.dimension)
    Picture(axes, drawn, **{"color": COLOURS[0], "linewidth": thick, **body})
    axes.set_axis_off()
    return cast(Figure, axes.figure)


def _coordinates(
    scene: Scene, system: AbstractSystem | None, q: Any, t: float
) -> Float[np.ndarray, "1 n"]:
    """The coordinates of the bodies for a `q` as given, of the scene of a `system` if there is one.

    Raises InputError for a q that is none.
    """
    _, n = columns_of(scene.bodies)
    reduced = None if system is None else reduced_of(system)
    if q is None:
        position = _start(scene, system, reduced)
    else:
        position = _numbers(q)
        check_finite("configuration", "q", position)
        # As many as the bodies have are those of the bodies.
        if reduced is not None and position.shape == (reduced.n,) and reduced.n < n:
            position = _lifted(reduced, jnp.asarray(t, float), as_array(position))
    found = bodies_coordinates((*scene.joints, *scene.effects), np.asarray(position)[None], n)
    if found.shape != (1, n):
        own = f", and those of the reduced system ({reduced.n},)" if reduced is not None else ""
        raise InputError(
            f"configuration: q has shape {position.shape}, but the coordinates of the bodies have "
            f"({n},){own}; give one position, such as run.q[-1].",
            field="q",
        )
    return found


def _start(
    scene: Scene, system: AbstractSystem | None, reduced: AbstractReducedSystem | None
) -> Float[Array | np.ndarray, " n"]:
    if reduced is not None:
        return _lifted(reduced, reduced.time, reduced.q0)
    if system is not None:
        return system.q0
    return np.concatenate([part.start()[0] for part in scene.bodies])


def _numbers(q: Any) -> Float[np.ndarray, "..."]:
    try:
        return np.asarray(q, float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"configuration: q is of type {type(q).__name__}; give the coordinates of one "
            "position, such as run.q[-1].",
            field="q",
        ) from error


@program_once
def _lifted(
    system: AbstractReducedSystem, t: Float[Array, ""], z: Float[Array, " r"]
) -> Float[Array, " n"]:
    return system.reconstruct(t, z, jnp.zeros_like(z))[0]
