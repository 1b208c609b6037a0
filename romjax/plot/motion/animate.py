"""From runs and modes to a moving picture."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...analysis.modes import Modes
from ...assembly.counting import bodies_coordinates
from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...basis.basis import Basis
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...scene.marker import Marker
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..palette import VIEW, View
from ..shapes import amplitudes
from .animation import Animation
from .arrows import with_forces
from .designs import course, mechanism_of, scenes_of
from .frames import Clock, Model, exaggeration, models, playing_rate

FRAMES = 600
# Of one period of a mode, with the first one repeated at the end; and how fast it passes [°/s].
PERIOD, TURNING = 61, 180.0
MODES = 24  # the most


def animate(
    mechanism: Scene | AbstractSystem,
    *motions: Trajectory | Modes | Basis,
    labels: Sequence[str] | None = None,
    trace: Marker | Sequence[Marker] = (),
    deformation: int | float | None = None,
    forces: bool = False,
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
    - `frames`: the most frames; output times are left out where there are more.
    - `title`: of the page.
    - `view`: azimuth against the x axis and elevation of the view of space [rad]; the page's can be
      turned.

    Raises InputError if runs and mechanism do not fit.
    """
    traced = [trace] if isinstance(trace, Marker) else list(trace)
    given = 1.0 if deformation is None else float(deformation)
    if not (np.isfinite(given) and given >= 0 and frames >= 1):
        raise InputError(
            f"animate: deformation is {deformation} and frames is {frames}; the first must not be "
            "negative, and there must be a frame."
        )
    scene = _scene_of(mechanism)
    if any(isinstance(motion, Modes) for motion in motions):
        return _swinging(mechanism, scene, motions, traced, given, title, view)
    if any(isinstance(motion, Basis) for motion in motions):
        return _of_basis(scene, motions, traced, given, title, view)
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
        t, q = np.zeros(1), {"": np.concatenate([body.start()[0] for body in scene.bodies])[None]}
        scenes = [scene]
    clock = Clock("t", "s", playing_rate(float(np.ptp(t))))
    if all(own is scene for own in scenes):
        drawn = models(scene, t, q, traced)
    else:  # designs that differ, each by its own numbers
        pairs = zip(scenes, q.items(), strict=True)
        drawn = [models(own, t, {name: values}, traced)[0] for own, (name, values) in pairs]
    scale = exaggeration(drawn) if deformation is None else given
    if forces and runs:
        drawn[0] = with_forces(drawn[0], runs[0], chosen)
    return Animation(t, drawn, clock, scale, title=title, view=view)


def animate_run(run: Trajectory, *others: Trajectory, **options: Any) -> Animation:
    """A run, and `others` over it, by the mechanism that it carries; `options` of `animate`.

    Raises InputError for a run that carries none.
    """
    if np.ndim(run.t) != 1:
        raise InputError(_batch("Trajectory.animate", run))
    full = mechanism_of(run)
    if full is None:
        raise InputError(
            "Trajectory.animate: this run, of a transformation of JAX or by a method of diffrax "
            "that is implicit, does not know its mechanism; call romjax.animate(scene, run)."
        )
    return animate(full, run, *others, **options)


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


def _swinging(
    mechanism: Scene | AbstractSystem,
    scene: Scene,
    motions: Sequence[Any],
    traced: Sequence[Marker],
    deformation: float,
    title: str,
    view: View,
) -> Animation:
    """Each mode through a period, about where it was taken, one at a time."""
    (modes,) = motions if len(motions) == 1 else (None,)
    if modes is None or isinstance(mechanism, Scene):
        raise InputError(
            "animate: modes are drawn by themselves, and with the system that they are of: "
            "romjax.animate(system, romjax.modes(system))."
        )
    if modes.at.shape != (mechanism.n,):
        raise InputError(
            f"animate: the modes are of {modes.at.shape} coordinates, but the system has "
            f"{mechanism.n}; give the system that they are of."
        )

    # Displacements are as velocities: of a reduced system, in physical coordinates.
    def push(w: Float[Array, " r"]) -> Float[Array, " n"]:
        return mechanism.state(0.0, modes.at, w).v

    real, imaginary = (
        np.stack([np.asarray(push(jnp.asarray(w))) for w in part.T], axis=1)
        for part in np.asarray([modes.shapes.real, modes.shapes.imag])[:, :, :MODES]
    )
    reference = np.asarray(mechanism.state(0.0, modes.at, jnp.zeros_like(modes.at)).q)
    hertz = np.asarray(modes.frequencies)[:MODES] / (2 * np.pi)
    names = [f"mode {k + 1}: {x:.4g} Hz" for k, x in enumerate(hertz)]
    swings = _Swings(reference, real, imaginary, names)
    return swings.animation(scene, traced, deformation, title, view)


def _of_basis(
    scene: Scene,
    motions: Sequence[Any],
    traced: Sequence[Marker],
    deformation: float,
    title: str,
    view: View,
) -> Animation:
    """Each mode of a basis through a period, about its offset, one at a time."""
    (basis,) = motions if len(motions) == 1 else (None,)
    if basis is None:
        raise InputError("animate: a basis is drawn by itself: romjax.animate(scene, basis).")
    reference, vectors = np.asarray(basis.offset), np.asarray(basis.modes)[:, :MODES]
    wanted = sum(len(body.coordinates()) for body in scene.bodies)
    # Behind those of the bodies there may be counters of turns.
    parts = (*scene.joints, *scene.effects)
    if bodies_coordinates(parts, reference[None], wanted).shape[1] != wanted:
        raise InputError(
            f"animate: the basis is of {len(reference)} coordinates, but the bodies of the scene "
            f"have {wanted}; give the scene that it is of."
        )
    shares = np.asarray(basis.values) / np.asarray(basis.values)[0]
    names = [f"mode {k + 1}: {shares[k]:.2g} of the first" for k in range(vectors.shape[1])]
    swings = _Swings(reference, vectors, np.zeros_like(vectors), names)
    return swings.animation(scene, traced, deformation, title, view)


class _Swings(NamedTuple):
    """Modes (n, r) with their names, that swing about the configuration `reference` (n,)."""

    reference: np.ndarray
    real: np.ndarray
    imaginary: np.ndarray
    names: list[str]

    def animation(
        self, scene: Scene, traced: Sequence[Marker], deformation: float, title: str, view: View
    ) -> Animation:
        """One at a time, through a period."""
        sides = np.concatenate([self.real, self.imaginary], axis=1)
        sizes = amplitudes(scene, self.reference, sides)
        sizes = np.where(sizes > 0, sizes, np.inf).reshape(2, -1).min(axis=0)
        phase = np.linspace(0.0, 2 * np.pi, PERIOD)
        cosine, sine = np.cos(phase)[:, None, None], np.sin(phase)[:, None, None]
        motion = self.real * cosine - self.imaginary * sine
        motion = motion * np.where(np.isfinite(sizes), sizes, 0.0)
        named = {name: self.reference + motion[:, :, k] for k, name in enumerate(self.names)}
        return _drawn(scene, named, np.rad2deg(phase), traced, deformation, title, view)


def _drawn(
    scene: Scene,
    named: dict[str, np.ndarray],
    degrees: np.ndarray,
    traced: Sequence[Marker],
    deformation: float,
    title: str,
    view: View,
) -> Animation:
    """Motions over a phase [°], one at a time."""
    drawn = [
        Model(
            name, *([o for o in side if o.style != "load"] for side in sides)
        )  # they know no time
        for name, *sides in models(scene, np.zeros(PERIOD), named, traced)
    ]
    clock = Clock("phase", "°", TURNING)
    return Animation(degrees, drawn, clock, deformation, alternatives=True, title=title, view=view)
