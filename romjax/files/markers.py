"""Markers as texts: "body" or "body.point"."""

from collections.abc import Collection

from ..scene.marker import GROUND
from .forms import Form, Numbers, RotationForm

# How a marker in space may be turned: to an axis, or by a rotation.
TURNS: dict[str, Form] = {"axis": Numbers((3,)), "rotation": RotationForm()}


def split_marker(text: str, bodies: Collection[str]) -> tuple[str, str]:
    """Body and point of a marker, empty for the origin; both names may have dots."""
    cuts = [i for i, letter in enumerate(text) if letter == "."]
    if text in bodies or text == GROUND or not cuts:
        return text, ""
    known = [cut for cut in cuts if text[:cut] in bodies or text[:cut] == GROUND]
    cut = known[-1] if known else cuts[0]
    return text[:cut], text[cut + 1 :]
