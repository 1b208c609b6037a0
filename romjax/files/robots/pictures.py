"""Outlines that the bodies of a robot are drawn by."""

from typing import Any

import numpy as np

from ...scene.placement import Placement

# A body without a geom and without a point beside its origin has this edge [m].
_SMALL = 0.05
# Other bodies without a geom have a smallest edge of this share of the largest.
_THIN = 0.1
# MuJoCo has these numbers for spheres, capsules, ellipsoids, cylinders and boxes.
_SHAPES = (2, 3, 4, 5, 6)
# A way along the edges of a box, by its corners.
_WAY = (0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4)
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def outline_of(arrays: Any, links: list[int], within: Any) -> Any:
    """The edges (corners, 3) of boxes around the geoms of a body, one after the other [m]; of one
    without geoms, of a box around its points, which fits the size of the robot.
    """
    lines = []
    for geom in range(arrays.ngeom):
        link, kind = int(arrays.geom_bodyid[geom]), int(arrays.geom_type[geom])
        if link not in links or kind not in _SHAPES:
            continue
        box = _CORNERS[list(_WAY)] * _half_edges(kind, arrays.geom_size[geom])
        place = within[link].then(Placement(arrays.geom_pos[geom], arrays.geom_quat[geom]))
        lines.append(place.point(box))
    if lines:
        return np.concatenate(lines)
    points = _points(arrays, links, within)
    low, high = points.min(axis=0), points.max(axis=0)
    largest = np.max(high - low)
    half = np.maximum(0.5 * (high - low), 0.5 * (_THIN * largest if largest else _SMALL))
    return 0.5 * (low + high) + half * _CORNERS[list(_WAY)]


def _points(arrays: Any, links: list[int], within: Any) -> Any:
    """Return the points at which a body begins, and at which its sites, links, and carried bodies
    are.
    """
    points = [within[link].position for link in links]
    for positions, owners in (
        (arrays.site_pos, arrays.site_bodyid),
        (arrays.body_pos[1:], arrays.body_parentid[1:]),
    ):
        pairs = zip(positions, owners, strict=True)
        points += [within[int(link)].point(at) for at, link in pairs if int(link) in links]
    return np.stack(points)


def _half_edges(kind: int, size: Any) -> Any:
    """Half of the edges of the box around a shape."""
    if kind == 2:
        return np.full(3, size[0])
    if kind in (3, 5):
        return np.array([size[0], size[0], size[1] + (size[0] if kind == 3 else 0.0)])
    return np.array(size)
