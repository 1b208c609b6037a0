"""Ports of a mesh: how joints and effects hold its nodes, and how they follow them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ...common.arrays import Vector
from ...common.errors import SceneError
from .component_modes import Matrix
from .mesh_rows import rigid_motion

# "rigid": the nodes move as one body. "mean": they move as they do, the port as the rigid motion
# that is nearest to theirs, and a load on it is shared among them. "point": one node, of which a
# mesh without rotations has no turning.
KINDS = ("rigid", "mean", "point")
PortNodes = Vector | Mapping[str, Vector]
# Directions in which nodes spread by less than this share of the largest spread are none.
FLAT = 1e-9


class Port(NamedTuple):
    """The nodes of a port, and their mean place."""

    name: str
    kind: str
    nodes: np.ndarray  # (k,)
    centre: np.ndarray  # (d,) [m]
    rows: np.ndarray  # of the matrices, (m,)
    motion: (
        np.ndarray
    )  # displacements of these rows by rigid motions about the centre, (m, motions)

    @property
    def turns(self) -> bool:
        """Whether the port knows how it is turned."""
        return bool(self.motion.shape[1] > len(self.centre))

    @property
    def shares(self) -> bool:
        """Whether it shares loads among nodes that move as they do."""
        return self.kind == "mean" or not self.turns

    def follow(self, elastic: np.ndarray) -> np.ndarray:
        """Displacement and rotation of the port, (3 or 6, modes), by displacements (n, modes)."""
        motions = np.zeros((3 * (len(self.centre) - 1), elastic.shape[1]))
        # The rigid motion that is nearest to that of the nodes, in the mean square; its transpose
        # below shares loads so that they do the same work.
        motions[: self.motion.shape[1]] = np.linalg.pinv(self.motion) @ elastic[self.rows]
        return motions

    def loads(self, size: int) -> np.ndarray:
        """Forces on the nodes for unit forces and torques on the port, (size, motions): they do the
        same work.
        """
        forces = np.zeros((size, self.motion.shape[1]))
        forces[self.rows] = np.linalg.pinv(self.motion).T
        return forces


def ports_of(
    owner: str, given: Mapping[str, PortNodes], positions: np.ndarray, rows: np.ndarray
) -> list[Port]:
    """The ports as they were declared: by nodes, which are then rigid, or by a kind and its nodes.

    `positions` (nodes, d) [m]; `rows` (nodes, k) of the matrices, as of `rows_of`. Raises
    SceneError for kinds that there are not, nodes that the mesh does not have, and nodes that do
    not say how a port turns.
    """
    if not given:
        raise SceneError(f"{owner}: it has no ports; give the nodes where joints and effects act.")
    ports = []
    for name, value in given.items():
        kind, nodes = _kind(owner, name, value)
        if not nodes.size or nodes.min() < 0 or nodes.max() >= len(positions):
            raise SceneError(
                f"{owner}: port '{name}' has the nodes {nodes.tolist()}; the mesh has nodes 0 to "
                f"{len(positions) - 1}."
            )
        if kind == "point" and len(nodes) > 1:
            raise SceneError(
                f"{owner}: port '{name}' is a point of {len(nodes)} nodes; give one of them, or "
                "make it 'mean' or 'rigid'."
            )
        ports.append(_port(owner, name, kind, nodes, positions, rows))
    return ports


def _kind(owner: str, name: str, value: Any) -> tuple[str, np.ndarray]:
    if not isinstance(value, Mapping):
        return "rigid", np.atleast_1d(np.asarray(value, int))
    if len(value) != 1 or next(iter(value)) not in KINDS:
        raise SceneError(
            f"{owner}: port '{name}' is {dict(value)}, but it must be nodes, or a kind with its "
            f"nodes, such as {{'mean': [3, 4, 5]}}; kinds are {', '.join(KINDS)}."
        )
    ((kind, nodes),) = value.items()
    return kind, np.atleast_1d(np.asarray(nodes, int))


def _port(
    owner: str, name: str, kind: str, nodes: np.ndarray, positions: np.ndarray, rows: np.ndarray
) -> Port:
    d = positions.shape[1]
    centre = positions[nodes].mean(axis=0)
    own = rows[nodes]
    if kind == "mean":  # of displacements: rotations of single nodes may be those of a corner
        own = own[:, :d]
    motion = rigid_motion(positions[nodes] - centre[None], own >= 0)
    own = own[own >= 0]
    if kind == "point" and len(own) == d:
        motion = motion[:, :d]
    # The rank is that of lengths over the size of the port, so that no unit matters.
    size = np.max(np.abs(motion), axis=0)
    if not np.all(size > 0) or np.linalg.matrix_rank(motion / size, FLAT) < motion.shape[1]:
        what, remedy = ("one point", "a rim or an edge, two or more")
        if d == 3:
            what, remedy = ("on one line", "a rim or a face, three or more")
        alone = "displacements alone" if kind == "mean" else "a mesh without rotations"
        hinge = "" if kind == "mean" else ", or make it a 'point' for forces and ball joints"
        raise SceneError(
            f"{owner}: port '{name}' is {what} of {alone}, which does not say how it turns; give "
            f"the nodes of {remedy}{hinge}."
        )
    return Port(name, kind, nodes, centre, own, motion)


def tie(owner: str, ports: list[Port], size: int) -> tuple[Matrix, np.ndarray]:
    """The rows of the mesh, `size` of them, by the free ones and the motions of each rigid port;
    and the columns of these motions.
    """
    held = [port for port in ports if not port.shares]
    taken = np.zeros(size, bool)
    for port in held:
        if np.any(taken[port.rows]):
            raise SceneError(
                f"{owner}: port '{port.name}' shares nodes with another one that is rigid; only "
                "'mean' ones may."
            )
        taken[port.rows] = True
    free = np.flatnonzero(~taken)
    # Free rows stay as they are; the rows of a rigid port follow its three or six motions.
    entries, down, along, count = [np.ones(len(free))], [free], [np.arange(len(free))], len(free)
    for port in held:
        width = port.motion.shape[1]
        entries.append(port.motion.ravel())
        down.append(np.repeat(port.rows, width))
        along.append(np.tile(count + np.arange(width), len(port.rows)))
        count += width
    places = np.concatenate(down), np.concatenate(along)
    matrix = sp.csc_array((np.concatenate(entries), places), shape=(size, count))
    return matrix, np.arange(len(free), count)
