"""Square rods between points of space, and markers along axes of space."""

from typing import Any

import numpy as np

from ..common.arrays import Number, Vector, as_array, untraced
from ..linalg import quaternions
from ..scene.body.base import AbstractBody
from ..scene.body.spatial.rigid import RigidBody
from ..scene.marker import Marker
from ..scene.orientation import quaternion_of

Point = tuple[float, float, float] | np.ndarray


def rod(
    name: str, start: Point, end: Point, mass: Number, edge: float, **options: Any
) -> RigidBody:
    """A uniform rod of square section [m], [kg] along its local z from its "start" to its "end"."""
    way = np.subtract(end, start)
    length = round(float(np.linalg.norm(way)), 12)  # as it was given, where points follow from it
    across = (length**2 + edge**2) / 12
    half = (0.0, 0.0, 0.5 * length)
    return RigidBody(
        name,
        mass,
        mass * np.array([across, across, edge**2 / 6]),
        position=0.5 * np.add(start, end),
        orientation=quaternion_of(name, axis=way),
        extent=(edge, edge, length),
        points={"start": np.negative(half), "end": half},
        **options,
    )


def towards(body: AbstractBody, point: Vector | str, axis: Vector) -> Marker:
    """The marker of a body whose z axis is along an `axis` of space at the start."""
    q, along = untraced(body.start()[0], as_array(axis))
    return body.at(point, axis=quaternions.rotate(quaternions.conjugate(q[3:7]), along))
