"""Moving pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

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
    # A fixed height, since matplotlib would search free space above all ticks at each frame.
    title = axes.set_title("", y=1.01)
    digits = max(0, int(np.ceil(-np.log10(max(t[-1] - t[0], 1e-12) / count))))
    artists = [title, *(line for picture in pictures for line in picture.lines.values())]
    background = _Background(figure, artists)
    frames = []
    for frame, index in enumerate(chosen):
        for picture in pictures:
            picture.show(frame)
        title.set_text(f"t = {t[index]:.{digits}f} s")
        frames.append(background.with_artists())
    first_frame, *others = frames
    first_frame.save(path, save_all=True, append_images=others, duration=round(1000 / fps), loop=0)
    return Path(path)


class _Background:
    """What stays the same in all frames of a figure, drawn once: it takes most of the time."""

    def __init__(self, figure: Figure, artists: Sequence[Artist]):
        self.figure, self.artists = figure, artists
        self.canvas = FigureCanvasAgg(figure)
        for artist in artists:
            artist.set_animated(True)
        self.canvas.draw()
        self.drawn = self.canvas.copy_from_bbox(figure.bbox)

    def with_artists(self) -> Image.Image:
        """The frame with the artists as they are now."""
        self.canvas.restore_region(self.drawn)
        for artist in self.artists:
            self.figure.draw_artist(artist)
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())).convert("RGB")


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
    """Indices of the output times nearest to the wanted ones."""
    indices: np.ndarray = np.argmin(np.abs(t[None] - wanted[:, None]), axis=1)
    return indices
