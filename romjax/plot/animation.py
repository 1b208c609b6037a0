"""Moving pictures."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure

from ..integrate.trajectory import Trajectory
from ..scene.scene import Scene
from .mechanism import Picture, bounds, stage, view
from .panels import check_coordinates, check_times
from .style import SMALL, line

FRAMES = 60  # unless the playing time is given
DPI = 80


def animate(
    scene: Scene,
    trajectories: Mapping[str, Trajectory],
    path: str | Path,
    fps: float = 25.0,
    seconds: float | None = None,
) -> Path:
    """Write a GIF of the mechanism as it moves in each model; the title tells the time.

    **Arguments:**

    - `trajectories`: motions (k, n) of the scene at the same times, by name; the first is drawn
      solid, the others dashed over it.
    - `path`: of the file. Returned.
    - `fps`: frames per second of playing time.
    - `seconds`: playing time [s]; without it, 60 frames or all output times if they are fewer.
      Fast or slow motion follows from it: each frame is one of the output times.

    Raises ValueError if motions and scene do not fit.
    """
    if not trajectories:
        raise ValueError("animate: there are no motions; give {'name': trajectory}.")
    if not fps > 0 or (seconds is not None and not seconds > 0):
        raise ValueError(f"animate: fps={fps} and seconds={seconds} must be positive.")
    first = next(iter(trajectories.values()))
    for name, motion in trajectories.items():
        check_coordinates("animate", first, name, motion)
        check_times("animate", first, name, motion)
    t = np.asarray(first.t)
    count = min(FRAMES, len(t)) if seconds is None else max(1, round(seconds * fps))
    chosen = _nearest(t, np.linspace(t[0], t[-1], count))

    # The layout is made once, not by an engine at each frame: that would double the time.
    figure = Figure(figsize=(6, 5), dpi=DPI)
    axes = figure.add_axes((0.12, 0.11, 0.84, 0.79))
    pictures = {
        name: Picture(axes, scene, np.asarray(motion.q)[chosen], **line(index))
        for index, (name, motion) in enumerate(trajectories.items())
    }
    shapes = [outline for picture in pictures.values() for outline in picture.outlines]
    stage(axes, scene, view(bounds(shapes)))
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
    handles = [picture.lines[0] for picture in pictures.values()]
    axes.legend(handles, list(pictures), loc="upper right", fontsize=SMALL + 1)
    title = axes.set_title("")
    digits = max(0, int(np.ceil(-np.log10(max(t[-1] - t[0], 1e-12) / count))))
    writer = PillowWriter(fps=fps)
    with writer.saving(figure, str(path), DPI):
        for frame, place in enumerate(chosen):
            for picture in pictures.values():
                picture.show(frame)
            title.set_text(f"t = {t[place]:.{digits}f} s")
            writer.grab_frame()
    return Path(path)


def _nearest(t: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Places of the output times nearest to the wanted ones."""
    return np.argmin(np.abs(t[None] - wanted[:, None]), axis=1)
