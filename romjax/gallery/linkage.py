"""Bars and triangles between points, and points at given distances from others."""

import math
from collections.abc import Mapping

import numpy as np

from ..common.arrays import Number
from ..common.errors import SceneError
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.marker import ground

Point = np.ndarray | tuple[float, float]


def bar(name: str, start: Point, end: Point, density: Number) -> Beam:
    """A rigid bar of some mass per length [kg/m] between two points [m], its "start" and "end"."""
    x, y = np.subtract(end, start)
    length = round(math.hypot(x, y), 12)  # as it was given, where the points follow from lengths
    body = Beam(name, density * length, length, angle=math.atan2(y, x))
    return body.placed("start", ground.pose(start))


def triangle(name: str, corners: Mapping[str, Point], density: Number) -> RigidBody:
    """A uniform plate of some mass per area [kg/m²] between three points [m] with these names."""
    points = np.array(list(corners.values()), float)
    centre = points.mean(axis=0)
    (ax, ay), (bx, by) = points[1:] - points[:1]
    mass = density * abs(ax * by - ay * bx) / 2
    return RigidBody(
        name,
        mass=mass,
        inertia=mass * float(np.sum((points - centre) ** 2)) / 12,
        position=centre,
        extent=points - centre,
        points=dict(zip(corners, points - centre, strict=True)),
    )


def meeting(a: Point, b: Point, from_a: float, from_b: float) -> np.ndarray:
    """The point at these distances [m] from a and from b that lies left of the way from a to b.

    Raises SceneError if the distances do not reach.
    """
    way = np.subtract(b, a)
    apart = float(np.hypot(*way))
    along = (apart**2 + from_a**2 - from_b**2) / (2 * apart)
    squared = from_a**2 - along**2
    if not squared > 0:
        raise SceneError(
            f"linkage: no point is {from_a:g} m from {tuple(a)} and {from_b:g} m from {tuple(b)}; "
            "make the bars longer, or their difference smaller."
        )
    across = np.array([-way[1], way[0]])
    point: np.ndarray = np.asarray(a) + (along * way + math.sqrt(squared) * across) / apart
    return point
