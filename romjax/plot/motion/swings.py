"""Modes that swing."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...analysis.modes import Modes
from ...assembly.counting import bodies_coordinates
from ...assembly.standing import standing
from ...common.errors import InputError
from ...scene.marker import Marker
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..palette import View
from ..shapes import amplitudes
from .animation import Animation
from .frames import Clock, Model, models

# Pictures of one period of a mode, with the first repeated at the end; and how fast it passes
# [°/s].
PERIOD, TURNING = 61, 180.0
MODES = 24  # the most


def swinging(
    mechanism: Scene | AbstractSystem,
    scene: Scene,
    motions: Sequence[Any],
    traced: Sequence[Marker],
    deformation: float,
    title: str,
    view: View,
) -> Animation:
    """Modes of a `mechanism`, or of a basis, each through a period, one at a time; the arguments
    are those of `animate`. Raises InputError if they do not fit.
    """
    if any(isinstance(motion, Modes) for motion in motions):
        swings = _of_modes(mechanism, motions)
    else:
        swings = _of_basis(scene, motions)
    return swings.animation(scene, traced, deformation, title, view)


def _of_modes(mechanism: Scene | AbstractSystem, motions: Sequence[Any]) -> "_Swings":
    """Each mode about where it was taken."""
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

    # Displacements are as velocities: of a reduced system, in physical coordinates, which drives
    # move along with the time.
    still, t = standing(mechanism, modes.t), jnp.asarray(modes.t, modes.at.dtype)

    def push(w: Float[Array, " r"]) -> Float[Array, " n"]:
        return still.state(t, modes.at, w).v

    real, imaginary = (
        np.stack([np.asarray(push(jnp.asarray(w))) for w in part.T], axis=1)
        for part in np.asarray([modes.shapes.real, modes.shapes.imag])[:, :, :MODES]
    )
    reference = np.asarray(still.state(t, modes.at, jnp.zeros_like(modes.at)).q)
    hertz = np.asarray(modes.frequencies)[:MODES] / (2 * np.pi)
    names = [f"mode {k + 1}: {x:.4g} Hz" for k, x in enumerate(hertz)]
    return _Swings(reference, real, imaginary, names, float(t))


def _of_basis(scene: Scene, motions: Sequence[Any]) -> "_Swings":
    """Each mode of a basis about its offset."""
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
    names[0] = "mode 1"
    return _Swings(reference, vectors, np.zeros_like(vectors), names, 0.0)


class _Swings(NamedTuple):
    """Modes (n, r) with their names, that swing about the configuration `reference` (n,) of a
    time t [s].
    """

    reference: np.ndarray
    real: np.ndarray
    imaginary: np.ndarray
    names: list[str]
    t: float

    def animation(
        self, scene: Scene, traced: Sequence[Marker], deformation: float, title: str, view: View
    ) -> Animation:
        """One at a time, through a period."""
        sides = np.concatenate([self.real, self.imaginary], axis=1)
        sizes = amplitudes(scene, self.t, self.reference, sides)
        sizes = np.where(sizes > 0, sizes, np.inf).reshape(2, -1).min(axis=0)
        phase = np.linspace(0.0, 2 * np.pi, PERIOD)
        cosine, sine = np.cos(phase)[:, None, None], np.sin(phase)[:, None, None]
        motion = self.real * cosine - self.imaginary * sine
        motion = motion * np.where(np.isfinite(sizes), sizes, 0.0)
        named = {name: self.reference + motion[:, :, k] for k, name in enumerate(self.names)}
        named[""] = np.tile(self.reference, (PERIOD, 1))
        *moving, (_, at_rest, _) = models(scene, np.full(PERIOD, self.t), named, traced)
        # Where the bodies swing about, in grey and beneath, as surfaces are.
        beneath = [o._replace(style="surface") for o in at_rest if o.style == "body"]
        drawn = [
            # They know no time, and so no loads.
            Model(name, *([o for o in x if o.style != "load"] + beneath * bool(x) for x in sides))
            for name, *sides in moving
        ]
        clock, degrees = Clock("phase", "°", TURNING), np.rad2deg(phase)
        return Animation(
            degrees, drawn, clock, deformation, alternatives=True, title=title, view=view
        )
