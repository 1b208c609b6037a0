"""Figure of the loads of beams and joints at one time of a run."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...common.checks import unknown_name
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...measure.forces import joint_forces
from ...scene.marker import GROUND, Marker
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..mechanism import Picture, bounds, framed, stage
from ..motion.frames import Model, exaggeration, models
from ..panels import check_motion
from ..resultants import along_bodies, at_cuts, largest, name_of
from ..style import SMALL, DisplayedFigure

LONGEST = 0.15  # of an arrow, as a share of the picture's diagonal


class _Arrow(NamedTuple):
    """The force (k, 2) of the joint with the key `label` on the body of `marker`."""

    label: str
    marker: Marker
    force: np.ndarray


def loads(
    system: AbstractSystem,
    run: Trajectory,
    *,
    quantity: Literal["moment", "axial", "shear"] = "moment",
    bodies: str | Sequence[str] | None = None,
    t: float | None = None,
    forces: bool = True,
    deformation: float | None = None,
) -> Figure:
    """The mechanism at one time: a stress resultant of each beam in colour, forces of the joints.

    Arrows are the forces of joints on the bodies of their first markers that are not on the ground;
    the longest is labelled. Beneath is the shape without deformations, where these are exaggerated.

    **Arguments:**

    - `system`, `run`: full or reduced, of a mechanism in the plane.
    - `quantity`: "moment" [N m], "axial" or "shear" [N], of beams and rods, with the signs of
      `romjax.resultants`.
    - `bodies`: names of beams and rods that are coloured, by a scale of theirs; all unless given.
    - `t`: the output next to this time is shown [s]; unless given, the one at which the quantity is
      largest, or the largest force of a joint where there is no beam.
    - `forces`: whether the forces of joints are drawn.
    - `deformation`: what deformations are multiplied by; unless given, as many times as shows them
      where they are below a hundredth of the picture, and once where they are not.

    Raises InputError for a mechanism in space, another quantity, or a body that has none.
    """
    name = name_of("loads: quantity", quantity, 2)
    check_motion("loads: the run", run)
    scene = disassemble(assembled("loads", system))
    if scene.dimension != 2:
        raise InputError(
            "loads: the mechanism is in space, but loads are drawn in the plane; "
            f"animate(system, run, resultant='{quantity}', forces=True) shows them in space."
        )
    values = _of_bodies(along_bodies(system, run, scene, quantity), bodies)
    arrows = _arrows(system, scene, run) if forces or not values else []
    index = _index(run, t, values, arrows)
    for body, rows in values.items():
        if not np.all(np.isfinite(rows[index])):
            raise InputError(
                f"loads: the {name} of '{body}' is not finite at t = {float(run.t[index]):.4g} s; "
                "take another t, and see the run's summary()."
            )
    (model,) = models(
        scene,
        np.asarray(run.t)[[index]],
        {"": np.asarray(run.q)[[index]]},
        [a.marker for a in arrows],
    )
    scale = exaggeration([model]) if deformation is None else float(deformation)
    title = f"t = {float(run.t[index]):.4g} s"
    title += "" if scale == 1 else f", deformation × {scale:g}"
    at = {body: rows[[index]] for body, rows in values.items()}
    shown = [a._replace(force=a.force[index]) for a in arrows] if forces else []
    return _drawn(model, scale, at, shown, name, title)


def _of_bodies(
    values: dict[str, np.ndarray], bodies: str | Sequence[str] | None
) -> dict[str, np.ndarray]:
    if bodies is None:
        return values
    names = [bodies] if isinstance(bodies, str) else [*bodies]
    for name in names:
        if name not in values:
            raise unknown_name("loads: bodies", "beam or rod", name, values)
    return {name: values[name] for name in names}


def _arrows(system: AbstractSystem, scene: Scene, run: Trajectory) -> list[_Arrow]:
    table, arrows = joint_forces(system, run), []
    for label, joint in zip(_keys(scene, table), scene.joints, strict=True):
        sides = [i for i, marker in enumerate(joint.markers) if marker.body != GROUND]
        if sides:
            force = np.asarray(table[label].wrenches[sides[0]].force)
            arrows.append(_Arrow(label, joint.markers[sides[0]], force))
    return arrows


def _keys(scene: Scene, table: Any) -> list[str]:
    """The keys of the joints in their order; where several have one label, these are numbered."""
    labels, keys = [joint.label() for joint in scene.joints], []
    for i, label in enumerate(labels):
        keys.append(label if label in table else f"{label} {1 + labels[:i].count(label)}")
    return keys


def _index(
    run: Trajectory, t: float | None, values: dict[str, np.ndarray], arrows: list[_Arrow]
) -> int:
    if t is not None:
        return int(np.argmin(np.abs(np.asarray(run.t) - t)))
    sizes = [np.max(np.abs(rows), axis=1) for rows in values.values()]
    sizes = sizes or [np.linalg.norm(arrow.force, axis=1) for arrow in arrows]
    if not sizes:
        return 0
    most = np.max(sizes, axis=0)
    return int(np.argmax(np.where(np.isfinite(most), most, -1.0)))


def _drawn(
    model: Model,
    scale: float,
    values: dict[str, np.ndarray],
    arrows: list[_Arrow],
    name: str,
    title: str,
) -> Figure:
    shown = model.deformed(scale)
    traces = [o.points[0, 0] for o in shown if o.style == "trace"]
    outlines = [o for o in shown if o.style not in ("trace", "load")]
    box = framed(bounds(outlines))
    width, height = box[1] - box[0]
    tall = float(np.clip(6.5 * height / width, 2.6, 7.0))
    # The figure is as slim as the mechanism, with room for the scale of colours; the title asks for
    # the least.
    across = float(np.clip(tall * width / height + 1.5, 4.2, 8.0))
    figure = DisplayedFigure(figsize=(across, tall + 0.9))
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    stage(axes, box)
    if scale != 1:
        straight = [o for o in model.deformed(0.0) if o.style == "body"]
        Picture(axes, straight, details=False, color="0.7", linewidth=1.4, zorder=1)
    coloured = [
        o._replace(points=at_cuts(o.points), values=values[o.part])
        if o.style == "body" and o.part in values
        else o
        for o in outlines
    ]
    colours = Picture(axes, coloured, color="0.25", linewidth=2.0).colours
    if colours is not None:
        colours.set_clim(-largest(values), largest(values))
        figure.colorbar(colours, ax=axes, label=name, shrink=0.8)
    if arrows:
        _draw_forces(axes, arrows, np.array(traces), LONGEST * float(np.hypot(width, height)))
    axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    axes.set_title(title, fontsize=11)
    return figure


def _draw_forces(axes: Axes, arrows: list[_Arrow], feet: np.ndarray, longest: float) -> None:
    forces = np.array([arrow.force for arrow in arrows])
    sizes = np.linalg.norm(forces, axis=1)
    most = float(np.max(sizes)) or 1.0
    tips = feet + forces * longest / most
    for foot, tip, size in zip(feet, tips, sizes, strict=True):
        if size > 1e-3 * most:
            style = {
                "arrowstyle": "-|>",
                "color": "#009E73",
                "linewidth": 1.8,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axes.annotate("", tip, foot, arrowprops=style, zorder=4, annotation_clip=False)
    text = np.format_float_positional(most, 3, fractional=False, trim="-")
    place: dict[str, Any] = {
        "xytext": (0, 7),
        "textcoords": "offset points",
        "ha": "center",
        "zorder": 5,
    }
    paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.0}
    axes.annotate(
        f"{text} N",
        tips[np.argmax(sizes)],
        color="#006B4F",
        fontsize=SMALL + 1,
        bbox=paper,
        **place,
    )
    # Where an arrow leaves the box, the box grows.
    low, high = np.min([*tips, *feet], axis=0), np.max([*tips, *feet], axis=0)
    margin = 0.25 * longest
    axes.set_xlim(
        min(axes.get_xlim()[0], low[0] - margin), max(axes.get_xlim()[1], high[0] + margin)
    )
    axes.set_ylim(
        min(axes.get_ylim()[0], low[1] - margin), max(axes.get_ylim()[1], high[1] + margin)
    )
