"""The nodes of the rows of the matrices of a mesh, and their rigid motions."""

import numpy as np

from ...common.arrays import Vector
from ...common.errors import SceneError
from .spatial.products import turned


def rows_of(
    owner: str, dimension: int, n: int, positions: np.ndarray, dofs: Vector | None
) -> np.ndarray:
    """Rows of the nodes in the matrices (nodes, 2 or 3 in the plane, 3 or 6 in space):
    displacements before rotations, −1 for the rotations of nodes without.

    Rows of `n` that belong to no node are modal coordinates, which rigid motion leaves at rest.
    """
    if positions.ndim != 2 or positions.shape[1] != dimension or not np.all(np.isfinite(positions)):
        raise SceneError(
            f"{owner}: nodes must be finite and (nodes, {dimension}), not {positions.shape}.",
            field="nodes",
        )
    nodes, widths = len(positions), (2, 3) if dimension == 2 else (3, 6)
    each = n // max(nodes, 1)
    rows = np.arange(each * nodes).reshape(nodes, each) if dofs is None else np.asarray(dofs, int)
    fits = rows.shape in [(nodes, width) for width in widths] and nodes > 0
    taken = np.sort(rows[rows >= 0], axis=None)
    within = taken.size > 0 and taken[-1] < n and np.all(np.diff(taken) > 0)
    if not fits or not within or (dofs is None and taken.size < n):
        own = "its x, its y or its rotation" if dimension == 2 else "a displacement or a rotation"
        raise SceneError(
            f"{owner}: {nodes} nodes and matrices of {n} rows; every row must belong to one node, "
            f"as {own}. Give dofs, (nodes, {widths[0]}) or (nodes, {widths[1]}), with −1 for the "
            "rotations of nodes without; rows that are in none of them are modal coordinates."
        )
    # Rotations may be missing, all of a node at once, and never its displacements.
    absent = np.sum(rows < 0, axis=1)
    partly = (absent > 0) & ((absent != rows.shape[1] - dimension) | (rows[:, 0] < 0))
    if np.any(partly):
        node = int(np.argmax(partly))
        raise SceneError(
            f"{owner}: node {node} has the rows {rows[node].tolist()}; a node has all its "
            "displacements, and all its rotations or none. Give dofs with −1 for those that it "
            "does not have."
        )
    return rows


def rigid_motion(positions: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Displacements of nodes by unit motions of the origin: along the axes, then about z in the
    plane, about all of them in space.

    `present` (nodes, k): whether nodes have each of k rows, displacements before rotations; only
    those are there, node after node.
    """
    d = positions.shape[1]
    around = turned(positions) if d == 3 else np.stack([-positions[:, 1:], positions[:, :1]], 1)
    motion = np.zeros((*present.shape, d + around.shape[2]))
    motion[:, :d, :d], motion[:, :d, d:] = np.eye(d), around
    motion[:, d:, d:] = np.eye(around.shape[2])[: present.shape[1] - d]
    return np.asarray(motion[present])
