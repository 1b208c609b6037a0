"""Faces of bodies in space that are drawn along their edges."""

import numpy as np
from jaxtyping import Float

ROUNDING = 1e-6  # of the size of a body, between corners and between planes


def faces(points: Float[np.ndarray, "points 3"]) -> list[list[int]]:
    """The faces of the convex body along whose edges a path goes, each by the numbers of its
    corners in the path, counter-clockwise from outside; none of a path that is no such thing, such
    as a line, or a flat one.

    A path along the edges of a body comes to its corners more than once, and all are corners of its
    hull; an axis that is bent comes nowhere twice.
    """
    size = float(np.max(np.ptp(points, axis=0)))
    if not (size > 0 and np.all(np.isfinite(points))):
        return []
    rounded = np.round(points / (ROUNDING * size)).astype(np.int64)
    _, numbers = np.unique(rounded, axis=0, return_index=True)
    corners = points[numbers]
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if not 4 <= len(corners) < len(points) - 1 or spread[-1] < ROUNDING * spread[0]:
        return []
    import scipy.spatial  # here, since it takes long to load and few ask for it

    hull = scipy.spatial.ConvexHull(corners)
    if len(hull.vertices) < len(corners):
        return []
    planes: dict[tuple[float, ...], set[int]] = {}
    for plane, triangle in zip(hull.equations, hull.simplices, strict=True):
        scaled = plane / (1.0, 1.0, 1.0, size)
        planes.setdefault(tuple(np.round(scaled, 5) + 0.0), set()).update(triangle.tolist())
    return [
        numbers[_around(corners, sorted(face), np.array(plane[:3]))].tolist()
        for plane, face in planes.items()
    ]


def _around(
    corners: Float[np.ndarray, "corners 3"], face: list[int], normal: Float[np.ndarray, "3"]
) -> list[int]:
    """The corners of a face in order, counter-clockwise about its normal."""
    away = corners[face] - corners[face].mean(axis=0)
    right = away[0] / np.linalg.norm(away[0])
    angle = np.arctan2(away @ np.cross(normal, right), away @ right)
    return [face[i] for i in np.argsort(angle)]
