"""A moving picture as one page of HTML, with all that it needs inside."""

import html
import json
from collections.abc import Sequence
from importlib import resources
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Float

from ...assembly.outlines import MovingOutline
from ..palette import COLOURS, STROKES, WIDTHS, View
from .coding import encode
from .colours import Colours
from .frames import Clock, Model
from .hulls import faces
from .outputs import Output

# Points are rounded to this share of the picture's diagonal, and an amplified deformation to as
# much of the largest that can be chosen.
RESOLUTION = 2.0**-15
# The largest deformation that can be chosen is about this share of the diagonal.
EXAGGERATED = 0.3
# Between two frames points move along straight lines where these are as close, as a share of the
# diagonal, to the path; else the picture shows nothing but its frames.
STRAIGHT = 0.01
# Pieces of the script, in this order, since each uses what those before it name; and the height of
# the chart of one output [px].
PIECES = (
    "decode",
    "view",
    "colours",
    "solids",
    "draw",
    "axes",
    "outputs",
    "gif",
    "saving",
    "controls",
)
CHART = 84


def page(
    title: str,
    t: Float[np.ndarray, " frames"],
    models: list[Model],
    clock: Clock,
    deformation: float,
    view: View,
    *,
    outputs: Sequence[Output] = (),
    colours: Colours | None = None,
    alternatives: bool,
    playing: bool,
) -> str:
    """The page of `models` at the times `t`.

    **Arguments:**

    - `title`: of the document.
    - `t`, `models`, `clock`: what it shows.
    - `deformation`, `view`: at first.
    - `outputs`: what is plotted under the motion. `colours`: the colours of loads, and their scale.
    - `alternatives`: whether one model is shown at a time, not all over each other.
    - `playing`: whether it begins by itself.
    """
    data = _data(t, models, clock, deformation)
    data |= {"alternatives": alternatives, "playing": playing, "outputs": [*map(_output, outputs)]}
    data["colours"] = None if colours is None else colours._asdict()
    if data["dimension"] == 3:
        data["view"] = view
    return player("page.html").format(
        title=html.escape(title),
        css=player("page.css"),
        script="\n".join(player(f"{name}.js") for name in PIECES),
        # Names may contain what would end the element.
        data=json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
    )


def player(name: str) -> str:
    """A file of the page."""
    return (resources.files(__package__) / "player" / name).read_text("utf-8")


def height(models: list[Model], outputs: int) -> int:
    """A height [px] that suits the mechanism and its outputs in a column of 700 px."""
    low, high = corners([o for model in models for o in model.actual])
    if len(low) == 3:  # it is as large from all sides
        return 660 + CHART * outputs
    width, tall = high - low + 0.15 * float(np.max(high - low))
    return int(np.clip(620 * tall / width, 220, 480)) + 195 + CHART * outputs


def corners(
    outlines: list[MovingOutline],
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
    """The least and the largest coordinates of what does not go on beyond the picture."""
    finite = [o.points for o in outlines if not o.endless]
    low = np.min([np.min(points, axis=(0, 1)) for points in finite], axis=0)
    high = np.max([np.max(points, axis=(0, 1)) for points in finite], axis=0)
    return low, high


def _data(
    t: Float[np.ndarray, " frames"], models: list[Model], clock: Clock, deformation: float
) -> dict[str, Any]:
    shown = [o for model in models for o in model.actual]
    low, high = corners(shown)
    diagonal = float(np.linalg.norm(high - low)) or 1.0
    scales = _scales(models, diagonal, deformation)
    bends = [RESOLUTION * diagonal / max(scales, default=1.0), RESOLUTION * diagonal]
    return {
        "dimension": int(shown[0].points.shape[2]),
        "frames": len(t),
        "times": encode(t[:, None], float(np.ptp(t)) * 2.0**-20 or 1.0),
        "clock": clock._asdict(),
        "smooth": _is_smooth(shown, STRAIGHT * diagonal),
        "scale": deformation,
        "scales": scales,
        "models": [
            {
                "name": model.name,
                "colour": COLOURS[index % len(COLOURS)] if index % len(COLOURS) else "var(--ink)",
                "dash": [WIDTHS[index > 0] * x for x in STROKES[index % len(STROKES)]],
                "width": WIDTHS[index > 0] + 0.4,
                "parts": _parts(model, *bends),
            }
            for index, model in enumerate(models)
        ],
    }


def _parts(model: Model, bend: float, move: float) -> list[dict[str, Any]]:
    """The outlines of each body, joint and effect in one block, which is small where they move
    together, and one of its deformation where it has one; in quanta of `bend` and `move`.
    """
    pairs = list(zip(model.actual, model.undeformed or model.actual, strict=True))
    parts = []
    for name, group in groupby(pairs, key=lambda pair: pair[0].part):
        own = list(group)
        actual, base = (
            np.concatenate([o.points.reshape(len(o.points), -1) for o in side], axis=1)
            for side in zip(*own, strict=True)
        )
        values = [o.values for o, _ in own if o.values is not None]
        parts.append(
            {
                "name": name,
                "values": _coded(np.concatenate(values, axis=1)) if values else None,
                "outlines": [_outline(o) for o, _ in own],
                "move": encode(base, move),
                "bend": encode(actual - base, bend) if np.any(actual != base) else None,
            }
        )
    return parts


def _outline(outline: MovingOutline) -> dict[str, Any]:
    points = outline.points
    closed = points.shape[1] > 2 and np.allclose(points[:, 0], points[:, -1], rtol=0, atol=1e-12)
    told = {
        "style": outline.style,
        "points": points.shape[1],
        "closed": bool(closed),
        "endless": outline.endless,
        "coloured": outline.values is not None,
    }
    solid = points.shape[2] == 3 and outline.style == "body"
    return told | {"faces": faces(points[0]) or None} if solid else told


def _output(output: Output) -> dict[str, Any]:
    return {
        "name": output.name,
        "curves": output.values.shape[1],
        "values": _coded(output.values),
    }


def _coded(values: Float[np.ndarray, "frames columns"]) -> dict[str, Any]:
    return encode(values, RESOLUTION * float(np.ptp(values)) or 1.0)


def _scales(models: list[Model], diagonal: float, deformation: float) -> list[float]:
    """Return the factors that deformations can be multiplied by; none where there are none."""
    moved = [
        np.max(np.abs(a.points - b.points))
        for model in models
        for a, b in zip(model.actual, model.undeformed, strict=bool(model.undeformed))
        if not a.endless
    ]
    largest = float(max(moved, default=0.0))
    if not largest > 0:
        return []
    series = [m * 10.0**k for k in range(7) for m in (1, 2, 5)]
    useful = [0.0, 1.0, *(x for x in series if 1 < x <= 2 * EXAGGERATED * diagonal / largest)]
    return sorted({*useful, deformation})


def _is_smooth(outlines: list[MovingOutline], allowed: float) -> bool:
    """Whether straight lines between the frames leave no path by more than what is `allowed`."""
    return all(
        np.max(np.abs(np.diff(o.points, 2, axis=0)), initial=0.0) / 8 <= allowed
        for o in outlines
        if not o.endless
    )
