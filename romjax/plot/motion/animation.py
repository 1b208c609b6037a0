"""The moving picture: it shows itself in notebooks, and saves itself as a page or as a film."""

import dataclasses
import html
import importlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...common import writing
from ...common.errors import InputError
from ..palette import VIEW, View
from .colours import Colours
from .frames import Clock, Model
from .outputs import Output
from .page import height, page

ENDINGS = (".html", ".gif", ".mp4")


@dataclasses.dataclass(frozen=True)
class Animation:
    """A mechanism as it moves, in one or several models over each other; made by `romjax.animate`.

    The last line of a notebook's cell shows it, in a frame of its own, so that several of them do
    not disturb each other. Space plays and stops, the arrows go from frame to frame and change the
    speed, dragging moves the picture (in space, turns it), the wheel, + and − change its size.
    Buttons save a frame as PNG, all of them as GIF, and in space show it from the front, the side
    and above.

    - `t`: times of the frames (frames,), in the unit of the `clock`.
    - `models`: what is drawn, in the order of the legend; the first is the reference.
    - `deformation`: modal deformations are drawn as many times as large; a slider changes it.
    - `alternatives`: whether one model is shown at a time.
    - `outputs`: what the page plots under the motion.
    - `title`: of the page.
    - `view`: azimuth against the x axis and elevation of the view of space at first [rad].
    - `colours`: what colours along bodies stand for, if there are any.
    """

    t: Float[np.ndarray, " frames"]
    models: list[Model]
    clock: Clock
    deformation: float = 1.0
    alternatives: bool = False
    outputs: Sequence[Output] = ()
    title: str = "romjax"
    view: View = VIEW
    colours: Colours | None = None

    def html(self, *, playing: bool = False) -> str:
        """The page; `playing`: whether it begins by itself."""
        return page(
            self.title,
            self.t,
            self.models,
            self.clock,
            self.deformation,
            self.view,
            outputs=self.outputs,
            colours=self.colours,
            alternatives=self.alternatives,
            playing=playing,
        )

    def embedded(self) -> str:
        """The page in a frame, as an element of another page."""
        tall = height(self.models, len(self.outputs))
        return (
            f'<iframe srcdoc="{html.escape(self.html())}" title="{html.escape(self.title)}" '
            f'style="width: 100%; height: {tall}px; border: 0"></iframe>'
        )

    _repr_html_ = embedded

    def __repr__(self) -> str:
        """In a line: a terminal shows no motion, and the points of all frames are thousands."""
        names = ", ".join(repr(model.name) for model in self.models if model.name)
        of = f" of {names}" if names else ""
        return f"Animation({len(self.t)} frames{of}; .save('….html') writes its page)"

    def save(
        self,
        path: str | Path,
        *,
        fps: int | float = 25,
        seconds: int | float | None = None,
        progress: bool | None = None,
    ) -> Path:
        """Write a page, a GIF or a film, by the ending of the `path`; returns the path.

        **Arguments:**

        - `path`: "….html" for a page that plays offline in any browser, "….gif", or "….mp4"
          (extra `video`).
        - `fps`, `seconds`: frames per second and playing time [s] of a GIF or a film; each of its
          frames is one of the animation's. Without `seconds`, it plays as fast as the page.
        - `progress`: whether to show a progress bar; unless given, in a terminal.

        Raises InputError for another ending, or numbers that make no film.
        """
        target = Path(path)
        ending = target.suffix.lower()
        if ending not in ENDINGS:
            raise InputError(
                f"Animation.save: path is '{path}', but it must end in {', '.join(ENDINGS)}."
            )
        if not fps > 0 or (seconds is not None and not seconds > 0):
            raise InputError(f"Animation.save: fps={fps} and seconds={seconds} must be positive.")
        if ending == ".html":
            writing.write(target, self.html(playing=True))
            return target
        # It needs matplotlib, which a page does not.
        film = importlib.import_module(".film", __package__)
        film.save(self, target, fps, seconds, progress)
        return target
