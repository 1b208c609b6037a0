"""Moving pictures of runs and modes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ...analysis.modes import Modes
from ...assembly.counting import bodies_coordinates
from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...basis.basis import Basis
from ...common.errors import InputError
from ...common.pictures import picture_of
from ...integrate.trajectory import Trajectory
from ...scene.marker import Marker
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..palette import VIEW, View
from ..resultants import Quantity
from .animation import Animation
from .arrows import with_forces
from .colours import with_resultants
from .designs import course, scenes_of
from .frames import Clock, exaggeration, models, playing_rate
from .outputs import Wanted, outputs_of
from .swings import swinging

FRAMES = 600


def animate(
    mechanism: Scene | AbstractSystem,
    *motions: Trajectory | Modes | Basis,
    labels: Sequence[str] | None = None,
    trace: Marker | Sequence[Marker] = (),
    deformation: int | float | None = None,
    forces: bool = False,
    resultant: Quantity | None = None,
    outputs: Wanted = (),
    frames: int = FRAMES,
    title: str = "romjax",
    view: View = VIEW,
) -> Animation:
    """The mechanism as it moves: shown by notebooks, saved as a page, a GIF or a film.

    **Arguments:**

    - `mechanism`: a scene, or a system, full or reduced, that was assembled from one.
    - `motions`: runs of it over each other; the first is the reference, at whose times the others
      are shown, to their ends. Runs of other numbers of the same parts, such as another design, are
      drawn by their own. Or `rj.modes(system)`, or a basis, of which each of the first 24 modes
      swings through a period; or nothing, for its start.
    - `labels`: names of the runs in the legend.
    - `trace`: markers whose paths are drawn.
    - `deformation`: what modal deformations are multiplied by at first, over the shape without
      them. Unless given, once where they are seen, and else as many times as shows them.
    - `forces`: whether the forces of the joints of the first run, on the bodies of their first
      markers, are drawn as arrows.
    - `resultant`: a stress resultant of the first run that is shown in colour along beams and rods:
      "moment", "axial", "shear", or in space "torque", which twists; as `rj.resultants` has it, of
      the moment and the shear force in space the size.
    - `outputs`: what the page plots under the motion, with a cursor at the time that is shown:
      labels of coordinates; how many coordinates, those that move most in the mass metric; or a
      dictionary of values by their names, an array (outputs,) of the first run or a list of one for
      each.
    - `frames`: the most frames; output times are left out where there are more.
    - `title`: of the page.
    - `view`: azimuth against the x axis and elevation of the view of space [rad]; the page's can be
      turned.

    Raises InputError if runs and mechanism do not fit, or no body has the `resultant`.
    """
    traced = [trace] if isinstance(trace, Marker) else list(trace)
    given = 1.0 if deformation is None else float(deformation)
    if not (np.isfinite(given) and given >= 0 and frames >= 1):
        raise InputError(
            f"animate: deformation is {deformation} and frames is {frames}; the first must not be "
            "negative, and there must be a frame."
        )
    scene = _scene_of(mechanism)
    if any(isinstance(motion, Modes | Basis) for motion in motions):
        if outputs or resultant:
            what = "outputs" if outputs else "resultants"
            raise InputError(f"animate: {what} are those of runs; modes have none.")
        return swinging(mechanism, scene, motions, traced, given, title, view)
    runs: Any = motions
    names = _names(len(runs), labels)
    for name, run in zip(names, runs, strict=True):
        _check(scene, name, run)
    if runs:
        times = np.asarray(runs[0].t, float)
        chosen = _spread(times, frames)
        t = times[chosen]
        q = {name: course(run, t) for name, run in zip(names, runs, strict=True)}
        scenes = scenes_of(scene, runs)
    else:
        chosen = np.zeros(1, int)
        t, q = np.zeros(1), {"": np.concatenate([body.start()[0] for body in scene.bodies])[None]}
        scenes = [scene]
    clock = Clock("t", "s", playing_rate(float(np.ptp(t))))
    if all(own is scene for own in scenes):
        drawn = models(scene, t, q, traced)
    else:  # designs that differ, each by its own numbers
        pairs = zip(scenes, q.items(), strict=True)
        drawn = [models(own, t, {name: values}, traced)[0] for own, (name, values) in pairs]
    scale = exaggeration(drawn) if deformation is None else given
    colours = None
    if resultant is not None and runs:
        drawn[0], colours = with_resultants(drawn[0], scenes[0], runs[0], chosen, resultant)
    if forces and runs:
        drawn[0] = with_forces(drawn[0], runs[0], chosen)
    plotted = outputs_of(outputs, runs, list(q.values()), chosen)
    return Animation(
        t, drawn, clock, scale, outputs=plotted, colours=colours, title=title, view=view
    )


@picture_of.register(Trajectory)
def animate_run(run: Trajectory, *others: Trajectory, **options: Any) -> Animation:
    """A run, and `others` over it, by the mechanism that it carries; `options` of `animate`.

    Raises InputError for a run that carries none.
    """
    if np.ndim(run.t) != 1:
        raise InputError(_batch("Trajectory.animate", run))
    return animate(assembled("Trajectory.animate", run.system), run, *others, **options)


@picture_of.register(Scene)
def _still(scene: Scene) -> Animation:
    return animate(scene)


def _scene_of(mechanism: Scene | AbstractSystem) -> Scene:
    if isinstance(mechanism, Scene):
        mechanism.check()
        return mechanism
    if not hasattr(mechanism, "full"):
        raise InputError(
            f"animate: the mechanism is a {type(mechanism).__name__}; give a Scene, or a system "
            "that was assembled from one."
        )
    return disassemble(assembled("animate", mechanism))


def _names(count: int, labels: Sequence[str] | None) -> list[str]:
    if labels is None:
        return [""] if count == 1 else [f"run {i + 1}" for i in range(count)]
    names = [str(label) for label in labels]
    if len(names) != count or len(set(names)) != count:
        raise InputError(
            f"animate: labels are {names} for {count} runs; give a different one for each."
        )
    return names


def _check(scene: Scene, name: str, run: Trajectory) -> None:
    """Raise InputError unless a run is one of the scene."""
    owner = f"animate: the run {name!r}" if name else "animate: the run"
    if not isinstance(run, Trajectory):
        raise InputError(f"{owner} is a {type(run).__name__}; give what romjax.simulate returns.")
    if np.ndim(run.q) != 2:
        raise InputError(_batch(owner, run))
    wanted = [c.label for body in scene.bodies for c in body.coordinates()]
    given = list(run.labels)
    # Behind those of the bodies there may be counters of turns.
    parts = (*scene.joints, *scene.effects)
    shown = bodies_coordinates(parts, np.asarray(run.q), len(wanted)).shape[1]
    if given[:shown] != wanted:
        alien = next((x for x in given if x not in wanted), f"{len(given)} of them")
        raise InputError(
            f"{owner} has other coordinates than the scene, {alien}: the bodies of the scene "
            f"({', '.join(body.name for body in scene.bodies)}) have {len(wanted)}; animate runs "
            "of this scene."
        )


def _batch(owner: str, run: Trajectory) -> str:
    return (
        f"{owner}: q has shape {np.shape(run.q)}; take one motion out of a batch, such as "
        "jax.tree.map(lambda x: x[0], run)."
    )


def _spread(t: Float[np.ndarray, " k"], most: int) -> Int[np.ndarray, " frames"]:
    """The numbers of the output times that are nearest to evenly spread ones; of few, all."""
    if len(t) <= most:
        return np.arange(len(t))
    nearest = np.argmin(np.abs(t[None] - np.linspace(t[0], t[-1], most)[:, None]), axis=1)
    return np.unique(nearest)
