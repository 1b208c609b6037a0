"""What the bodies of a robot are drawn as."""

from typing import Any

import numpy as np

from ...scene.placement import Placement

# Of a body without a geom, an edge [m].
_SMALL = 0.05
# By the numbers that MuJoCo gives to the shapes: spheres, capsules, ellipsoids, cylinders, boxes.
_SHAPES = (2, 3, 4, 5, 6)
# A way along the edges of a box, by its corners.
_WAY = (0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4)
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def outline_of(arrays: Any, links: list[int], within: Any) -> Any:
    """The edges (corners, 3) of boxes around the geoms of a body, one after the other [m]."""
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
    return 0.5 * _SMALL * _CORNERS[list(_WAY)]


def _half_edges(kind: int, size: Any) -> Any:
    """Half of the edges of the box around a shape."""
    if kind == 2:
        return np.full(3, size[0])
    if kind in (3, 5):
        return np.array([size[0], size[0], size[1] + (size[0] if kind == 3 else 0.0)])
    return np.array(size)
