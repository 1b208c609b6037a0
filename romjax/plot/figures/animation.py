"""Moving pictures."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...assembly.outlines import outlines
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene
from ..mechanism import Picture, bounds, stage, view
from ..panels import check_coordinates, check_times
from ..style import SMALL, line

FRAMES = 60  # unless the playing time is given
DPI = 80


def animate(
    scene: Scene,
    trajectories: Mapping[str, Trajectory],
    path: str | Path,
    fps: int | float = 25,
    seconds: int | float | None = None,
) -> Path:
    """Write a GIF of the mechanism as it moves in each model; the title tells the time.

    **Arguments:**

    - `scene`: the mechanism.
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
    if Path(path).suffix.lower() != ".gif":
        raise ValueError(f"animate: path is '{path}', but it must end in .gif.")
    if not fps > 0 or (seconds is not None and not seconds > 0):
        raise ValueError(f"animate: fps={fps} and seconds={seconds} must be positive.")
    first = next(iter(trajectories.values()))
    for name, motion in trajectories.items():
        check_coordinates("animate", first, name, motion)
        check_times("animate", first, name, motion)
    t = np.asarray(first.t)
    count = min(FRAMES, len(t)) if seconds is None else max(1, round(seconds * fps))
    chosen = _nearest(t, np.linspace(t[0], t[-1], count))

    figure = Figure(dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    moving = [
        outlines(scene, t[chosen], np.asarray(motion.q)[chosen]) for motion in trajectories.values()
    ]
    pictures = [
        Picture(axes, parts, details=index == 0, **line(index))
        for index, parts in enumerate(moving)
    ]
    box = view(bounds([part for parts in moving for part in parts]))
    stage(axes, box)
    _lay_out(figure, axes, box, pictures, list(trajectories))
    # A fixed height, since matplotlib would look for a free place above all ticks at each frame.
    title = axes.set_title("", y=1.01)
    digits = max(0, int(np.ceil(-np.log10(max(t[-1] - t[0], 1e-12) / count))))
    # It takes any number, but is declared to take whole ones.
    writer = PillowWriter(fps=cast(int, fps))
    with writer.saving(figure, str(path), DPI):
        for frame, place in enumerate(chosen):
            for picture in pictures:
                picture.show(frame)
            title.set_text(f"t = {t[place]:.{digits}f} s")
            writer.grab_frame()
    return Path(path)


def _lay_out(
    figure: Figure, axes: Axes, box: np.ndarray, pictures: list[Picture], names: list[str]
) -> None:
    """A figure as slim as the mechanism, with the legend below; in inches.

    Made once: an engine would lay out each frame anew, in twice the time.
    """
    width, height = (box[1] - box[0]) * np.min(np.array([5.0, 3.6]) / (box[1] - box[0]))
    wide = max(width + 1.1, 3.6)
    columns = int(np.clip(13 * wide / (max(map(len, names)) + 8), 1, len(names)))
    foot = 0.75 + 0.2 * -(-len(names) // columns)
    tall = foot + height + 0.4
    figure.set_size_inches(wide, tall)
    left = 0.8 + 0.5 * (wide - 1.1 - width)
    axes.set_position((left / wide, foot / tall, width / wide, height / tall))
    axes.locator_params(nbins=5)
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
    handles = [picture.lines["body"] for picture in pictures]
    figure.legend(handles, names, loc="lower center", ncols=columns, fontsize=SMALL + 1)


def _nearest(t: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Places of the output times nearest to the wanted ones."""
    places: np.ndarray = np.argmin(np.abs(t[None] - wanted[:, None]), axis=1)
    return places
