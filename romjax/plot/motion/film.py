"""Moving pictures as files of frames: GIF and MP4, drawn by matplotlib."""

import contextlib
import importlib
import itertools
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from tqdm import tqdm

from ...common.errors import InputError
from ...common.writing import replacing
from ..mechanism import Picture, bounds, framed, projected, stage
from ..palette import View
from ..style import GREY, SMALL, line, width
from .colours import Colours
from .frames import Clock, Model

DPI = 160
COLOURS, WHITE = 128, 248  # of a GIF: how many, and from which on they count as white


@runtime_checkable
class Filmed(Protocol):
    """The contents of a film, as `Animation` has them."""

    @property
    def t(self) -> Float[np.ndarray, " frames"]: ...
    @property
    def models(self) -> list[Model]: ...
    @property
    def clock(self) -> Clock: ...
    @property
    def deformation(self) -> float: ...
    @property
    def alternatives(self) -> bool: ...
    @property
    def colours(self) -> Colours | None: ...
    @property
    def view(self) -> View: ...


def save(
    animation: Filmed,
    path: Path,
    fps: int | float,
    seconds: int | float | None,
    progress: bool | None,
) -> None:
    """Write the film; the arguments are those of `Animation.save`."""
    writers = {".gif": _write_gif, ".mp4": _write_mp4}
    write = writers[path.suffix.lower()]
    chosen = _chosen(animation, fps, seconds)
    hidden = None if progress is None else not progress
    with tqdm(total=len(chosen), desc=path.name, unit="frame", disable=hidden) as bar:

        def frames() -> Iterator[UInt8[np.ndarray, "height width 3"]]:
            for frame in _frames(animation, chosen):
                yield frame
                bar.update()

        with replacing(path) as part:
            write(frames(), part, fps)


def _chosen(
    animation: Filmed, fps: int | float, seconds: int | float | None
) -> Int[np.ndarray, " chosen"]:
    """The numbers of the frames nearest to evenly spaced times."""
    t, span = animation.t, float(np.ptp(animation.t))
    seconds = span / animation.clock.rate if seconds is None else seconds
    count = max(1, round(seconds * fps))
    # What turns back into its first frame shows it once.
    wanted = np.linspace(t[0], t[-1], count, endpoint=not animation.alternatives)
    nearest: Int[np.ndarray, " chosen"] = np.argmin(np.abs(t[None] - wanted[:, None]), axis=1)
    return nearest


def _write_gif(
    frames: Iterator[UInt8[np.ndarray, "height width 3"]], path: Path, fps: int | float
) -> None:
    first = Image.fromarray(next(frames)).quantize(COLOURS)
    # Colours that are nearly white are taken for that of the page, which would be a little grey.
    colours = np.array(first.getpalette()).reshape(-1, 3)
    colours[np.all(colours >= WHITE, axis=1)] = 255
    first.putpalette(colours.ravel().tolist())
    # All frames have the colours of the first: to choose some for each takes most of the time.
    others = [
        Image.fromarray(frame).quantize(palette=first, dither=Image.Dither.NONE) for frame in frames
    ]
    # In hundredths of a second, the only times that the format knows.
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=10 * max(2, round(100 / fps)),
        loop=0,
    )


def _write_mp4(
    frames: Iterator[UInt8[np.ndarray, "height width 3"]], path: Path, fps: int | float
) -> None:
    try:
        encoder = importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except ImportError as error:
        raise InputError(
            "Animation.save: a film needs imageio-ffmpeg: pip install 'romjax[video]'; or save a "
            "page, '.html', or a '.gif'."
        ) from error
    first = next(frames)
    # The format wants even numbers of rows and columns.
    rows, columns = (2 * (length // 2) for length in first.shape[:2])
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", f"{fps:g}"]
    made = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18"]
    command = [encoder, "-y", "-loglevel", "error", *given, "-i", "-", *made, str(path)]
    # The writer of imageio-ffmpeg forks, which is unsafe beside JAX.
    process = subprocess.Popen(command, stdin=subprocess.PIPE)
    # It may end before it was given all, and says why.
    with contextlib.suppress(BrokenPipeError), process:
        assert process.stdin is not None
        for frame in itertools.chain([first], frames):
            process.stdin.write(np.ascontiguousarray(frame[:rows, :columns]).tobytes())
    if process.returncode:
        raise OSError("Animation.save: ffmpeg failed to write the film; see its message above.")


def _frames(
    animation: Filmed, chosen: Int[np.ndarray, " chosen"]
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """The chosen frames; of alternatives, the first is drawn."""
    models = animation.models[:1] if animation.alternatives else animation.models
    view = animation.view if models[0].actual[0].points.shape[2] == 3 else None
    drawn = [projected(model.deformed(animation.deformation), animation.view) for model in models]
    figure = Figure(dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    # Beneath exaggerated deformations, the shape of the first model without them.
    bare = models[0].deformed(0.0) if animation.deformation > 1 else []
    still = projected([o for o in bare if o.style == "body"], animation.view) if bare else []
    dimension = 2 if view is None else 3
    pictures = [
        Picture(axes, parts, details=index == 0, **line(index, dimension))
        for index, parts in enumerate(drawn)
    ]
    thin: dict[str, Any] = {"color": GREY, "linewidth": width(1.2, dimension), "zorder": 1}
    beneath = [Picture(axes, still, **thin)] if still else []
    box = framed(bounds([part for parts in drawn for part in parts]))
    stage(axes, box, view, [part for parts in drawn for part in parts])
    _lay_out(figure, axes, box, pictures, [model.name for model in models], animation.colours)
    # A fixed height, since matplotlib would search free space above all ticks at each frame.
    title = axes.set_title("", y=1.01)
    clock, span = animation.clock, float(np.ptp(animation.t)) or 1.0
    digits = max(0, int(np.ceil(-np.log10(span / len(chosen)))))
    times = "" if animation.deformation == 1 else f", deformation × {animation.deformation:g}"
    shown = [*beneath, *pictures]
    moving = sorted((x for picture in shown for x in picture.artists), key=Artist.get_zorder)
    artists = [title, *moving]
    background = _Background(figure, artists)
    for index in chosen:
        for picture in shown:
            picture.show(int(index))
        title.set_text(f"{clock.symbol} = {animation.t[index]:.{digits}f} {clock.unit}{times}")
        yield background.with_artists()


class _Background:
    """The part of a figure that stays the same in all frames, drawn once since it takes longest."""

    def __init__(self, figure: Figure, artists: Sequence[Artist]):
        self.figure, self.artists = figure, artists
        self.canvas = FigureCanvasAgg(figure)
        for artist in artists:
            artist.set_animated(True)
        self.canvas.draw()
        self.drawn = self.canvas.copy_from_bbox(figure.bbox)

    def with_artists(self) -> UInt8[np.ndarray, "height width 3"]:
        """The frame with the artists as they are now."""
        self.canvas.restore_region(self.drawn)
        for artist in self.artists:
            self.figure.draw_artist(artist)
        pixels: UInt8[np.ndarray, "height width 3"] = np.array(self.canvas.buffer_rgba())[..., :3]
        return pixels


def _lay_out(
    figure: Figure,
    axes: Axes,
    box: np.ndarray,
    pictures: list[Picture],
    names: list[str],
    colours: Colours | None,
) -> None:
    """A figure as slim as the mechanism, with the legend and the scale of colours below; in inches.

    Made once: an engine would lay out each frame anew, in twice the time.
    """
    width, height = (box[1] - box[0]) * np.min(np.array([5.0, 3.6]) / (box[1] - box[0]))
    wide = max(width + 1.1, 3.6)
    columns = int(np.clip(13 * wide / (max(map(len, names)) + 8), 1, len(names)))
    rows = -(-len(names) // columns) if any(names) else 0
    below = 0.2 * (rows + (rows > 0))
    foot = 0.55 + below + 0.5 * (colours is not None)
    tall = foot + height + 0.4
    figure.set_size_inches(wide, tall)
    left = 0.8 + 0.5 * (wide - 1.1 - width)
    axes.set_position((left / wide, foot / tall, width / wide, height / tall))
    axes.locator_params(nbins=5)
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
    scale = pictures[0].colours
    if colours is not None and scale is not None:
        scale.set_clim(-colours.largest, colours.largest)
        beneath = figure.add_axes((0.3, (0.3 + below) / tall, 0.4, 0.08 / tall))
        figure.colorbar(scale, cax=beneath, orientation="horizontal")
        beneath.set_xlim(colours.least, colours.largest)
        beneath.tick_params(labelsize=SMALL)
        beneath.set_title(colours.name, fontsize=SMALL, pad=3)
    if rows:
        handles = [picture.lines["body"] for picture in pictures]
        figure.legend(handles, names, loc="lower center", ncols=columns, fontsize=SMALL + 1)
