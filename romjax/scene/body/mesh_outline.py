"""The outline of a mesh: which of its nodes picture it, in the order of a path."""

import numpy as np

# A spread of positions smaller than this share of the largest one is rounding.
ROUNDING = 1e-10
# Directions in which the outermost nodes of a solid are looked for.
DIRECTIONS = 40


def outline(positions: np.ndarray) -> np.ndarray:
    """Nodes of the convex hull, closed; of a straight line, some of its nodes in order; of a solid,
    a path along all edges between its outermost nodes.
    """
    if len(positions) == 1:
        return np.zeros(1, int)
    _, spread, axes = np.linalg.svd(positions - positions.mean(axis=0)[None], full_matrices=False)
    thick = np.count_nonzero(spread > ROUNDING * spread[0])
    if thick == 1:
        order: np.ndarray = np.argsort(positions @ axes[0])
        some: np.ndarray = order[np.unique(np.linspace(0, len(order) - 1, 41).astype(int))]
        return some
    if thick == 3:
        return _edges(positions)
    import scipy.spatial  # here, since it takes long to load and few ask for it

    flat = positions if positions.shape[1] == 2 else positions @ axes[:2].T
    hull = scipy.spatial.ConvexHull(flat).vertices
    return np.append(hull, hull[0])


def _edges(positions: np.ndarray) -> np.ndarray:
    import scipy.spatial

    # Directions on a spiral, which has none of a mesh's symmetries, so that no two nodes tie. Equal
    # steps of height cut zones of equal area from a sphere, and the golden angle, π (3 − √5), turns
    # from each to the next.
    height = 1 - (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS
    angle = np.pi * (3 - 5**0.5) * np.arange(DIRECTIONS)
    across = np.sqrt(1 - height**2)
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), height])
    outer = np.unique(np.argmax(positions @ directions, axis=0))
    hull = scipy.spatial.ConvexHull(positions[outer])
    ahead: dict[int, set[int]] = {node: set() for node in range(len(outer))}
    for facet, normal, beside in zip(hull.simplices, hull.equations, hull.neighbors, strict=True):
        for corner, other in enumerate(beside):
            # Between triangles of one plane there is no edge.
            if not np.allclose(normal, hull.equations[other], atol=1e-6):
                a, b = (int(node) for node in np.delete(facet, corner))
                ahead[a].add(b)
                ahead[b].add(a)

    def walk(node: int) -> list[int]:
        path = [node]
        while ahead[node]:
            to = ahead[node].pop()
            ahead[to].remove(node)
            path += [*walk(to), node]
        return path

    start = next(node for node, others in ahead.items() if others)
    return outer[walk(start)]
