"""Frames of moving pictures: the outlines of one or several models at their times."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...assembly.kinematics import columns_of
from ...assembly.outlines import MovingOutline, outlines
from ...common.errors import InputError
from ...scene.marker import Marker
from ...scene.scene import Scene
from .undeformed import undeformed


class Model(NamedTuple):
    """One model in all frames.

    - `name`: in the legend. `actual`: its outlines. `undeformed`: those of the same motion without
      modal amplitudes, moved so that joints hold, in the same order; none where nothing bends.
    """

    name: str
    actual: list[MovingOutline]
    undeformed: list[MovingOutline]

    def deformed(self, scale: float) -> list[MovingOutline]:
        """Return the outlines of the model with the deformation times `scale`."""
        if not self.undeformed or scale == 1:
            return self.actual
        return [
            a._replace(points=b.points + scale * (a.points - b.points))
            for a, b in zip(self.actual, self.undeformed, strict=True)
        ]


# Deformations below this share of the picture's diagonal are hard to see, and are drawn as many
# times as large as makes them some of it; what is far below is rounding.
INVISIBLE, SHOWN, ROUNDING = 0.01, 0.04, 1e-7


def exaggeration(shown: Sequence[Model]) -> float:
    """Return the factor by which deformations are seen: 1, 2, 5 times a power of ten; 1 where
    they are seen as they are, or there are none.
    """
    bodies = [
        (a.points, b.points)
        for model in shown
        for a, b in zip(model.actual, model.undeformed, strict=bool(model.undeformed))
        if a.style == "body"
    ]
    if not bodies:
        return 1.0
    places = np.concatenate([a.reshape(-1, a.shape[2]) for a, _ in bodies])
    diagonal = float(np.linalg.norm(np.ptp(places, axis=0)))
    largest = max(float(np.max(np.linalg.norm(a - b, axis=2))) for a, b in bodies)
    # What is seen is drawn as it is, and what is rounding is not made visible.
    if not ROUNDING * diagonal < largest < INVISIBLE * diagonal:
        return 1.0
    # A round factor, since it is told beside the picture.
    wanted = SHOWN * diagonal / largest
    return max(m * 10.0**k for k in range(8) for m in (1, 2, 5) if m * 10.0**k <= wanted)


def models(
    scene: Scene,
    t: Float[np.ndarray, " frames"],
    motions: dict[str, Float[np.ndarray, "frames n"]],
    traced: Sequence[Marker],
) -> list[Model]:
    """The outlines of motions (frames, n) of a `scene` at the times `t`, by name.

    All at once, so that signs are of one size. A motion that ends in numbers that are not finite
    keeps its last position, and its name says so. Raises InputError for one that has none.
    """
    columns, _ = columns_of(scene.bodies)
    modal = [i for body in scene.bodies for i in columns[body.name][body.size - body.modes :]]
    count, shown, names = len(t), [], []
    for name, q in motions.items():
        held, end = _hold_last_finite(name, q)
        shown.append(held)
        names.append(name if end == count else f"{name} (until {t[end - 1]:.4g} s)".strip())
    actual = np.concatenate(shown)
    kinds = [actual]
    if modal and np.any(actual[:, modal]):
        kinds.append(undeformed(scene, np.tile(t, len(names)), actual, modal))
    # All models, deformed and not, in one call: one program, and outlines of equal shapes.
    drawn = outlines(scene, np.tile(t, len(kinds) * len(names)), np.concatenate(kinds), traced)
    drawn = [o for o in map(_finite, drawn) if o.points.shape[1]]
    made = []
    for row, name in enumerate(names):
        parts = [
            [
                o._replace(points=o.points[start : start + count])
                for o in drawn
                for start in [(kind * len(names) + row) * count]
            ]
            for kind in range(len(kinds))
        ]
        made.append(Model(name, parts[0], parts[1] if len(parts) > 1 else []))
    return made


def _hold_last_finite(
    name: str, q: Float[np.ndarray, "frames n"]
) -> tuple[Float[np.ndarray, "frames n"], int]:
    """Return a motion that keeps its last finite position, and the number of finite frames."""
    finite = np.all(np.isfinite(q), axis=1)
    end = len(q) if np.all(finite) else int(np.argmin(finite))
    if end == 0:
        raise InputError(
            f"animate: '{name}' has no frame with finite coordinates; see the run's summary()."
        )
    return q[np.minimum(np.arange(len(q)), end - 1)], end


def _finite(outline: MovingOutline) -> MovingOutline:
    """Remove the points that are not finite at some time: a curve may have no point there."""
    good = np.all(np.isfinite(outline.points), axis=(0, 2))
    return outline if np.all(good) else outline._replace(points=outline.points[:, good])


class Clock(NamedTuple):
    """The time of a picture: its `symbol`, its `unit`, and the `rate` at which it passes, in units
    per second.
    """

    symbol: str
    unit: str
    rate: float


# Playing time is between these, in seconds, where no speed is given.
SHORTEST, LONGEST = 4.0, 10.0


def playing_rate(span: float) -> float:
    """The speed, one of 1, 2, 5 times a power of ten, that plays `span` [s] in a pleasant time;
    real time, where that does.
    """
    if not span > 0 or SHORTEST <= span <= LONGEST:
        return 1.0
    powers = [m * 10.0**k for k in range(-12, 13) for m in (1, 2, 5)]
    # About six seconds, between the shortest and the longest.
    return min(powers, key=lambda rate: abs(np.log(span / rate / 6.0)))
