"""Checks of the markers between which joints and effects go."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from ..common.errors import SceneError
from .fields import check_kind
from .marker import Marker


def check_connected(part: Any) -> None:
    """Raise unless each field of a `part` that is declared as a marker holds one: not a body, nor a
    pose, which only places bodies.
    """
    owner = " ".join([type(part).__name__, *(repr(x) for x in [getattr(part, "name", "")] if x)])
    remedy = "a marker, such as body.at(point) or ground.at(point)"
    for field in dataclasses.fields(part):
        if field.type in (Marker, Marker.__name__):
            check_kind(owner, field.name, getattr(part, field.name), Marker, remedy)


def check_distinct(owner: str, a: Marker, b: Marker) -> None:
    """Raise if a joint would tie a body to itself."""
    if a.body == b.body:
        raise SceneError(
            f"{owner}: both markers are on '{a.body}'; a joint needs two bodies, "
            "or one body and the ground."
        )


def check_markers(owner: str, markers: Sequence[Marker], dimensions: tuple[int, ...]) -> None:
    """Check the markers of a part that there is in the plane (2), in space (3), or in both."""
    for marker in markers:
        marker.check(owner)
        if marker.dimension not in dimensions:
            words = {2: "the plane", 3: "space"}
            raise SceneError(
                f"{owner}: its marker on '{marker.body}' is in {words[marker.dimension]}, but the "
                f"part is one of {words[dimensions[0]]}; romjax has the parts of the plane, "
                "romjax.spatial those of space, at points x, y, z."
            )
        if marker.dimension != markers[0].dimension:
            raise SceneError(
                f"{owner}: its markers on '{markers[0].body}' and '{marker.body}' are in "
                f"{markers[0].dimension} and {marker.dimension} dimensions; give all points of a "
                "part x, y, z in space, or x, y in the plane."
            )
