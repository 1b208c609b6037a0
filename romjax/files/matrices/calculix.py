"""Matrices of CalculiX: *FREQUENCY, SOLVER=MATRIXSTORAGE, files .sti, .mas and .dof.

Rows are in the order of the nodes of solid elements, three of each or those that equations leave.
The file .dof calls the nodes of layers, to which shells and beams are expanded, by the node that
they stand for, so that its directions come again. Of plane stress the layers move as that node does
in the plane, and the changes of thickness remain.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .deck import Deck
from .entries import Entries, data_lines, existing, table, whole, wrong
from .nodes import Nodes

_COMMENT = "*"  # there is none
_THICKNESS = 3  # the direction across a mesh in plane stress


class Rows(NamedTuple):
    """Matrices by degrees of freedom (k, 2), whose nodes are numbered from 1 again where some stand
    for layers: `of` is then the number in the deck of each, and else None.
    """

    stiffness: Entries
    mass: Entries
    of: np.ndarray | None


def read(
    stiffness: Path, mass: Path | None, deck: Deck | None, nodes: Nodes, dimension: int
) -> Rows:
    """Read both matrices; files of the mass (unless given) and of the rows are beside the first.

    Raises InputError for rows that the deck does not tell.
    """
    cure = "run a step *FREQUENCY with SOLVER=MATRIXSTORAGE"
    path = existing(stiffness.with_suffix(".dof"), cure)
    dofs = _turning(path, _dofs(path), deck, nodes)
    of = None
    if deck is not None and deck.plane:
        if dimension == 3:
            raise wrong(deck.path, 0, "elements in plane stress or strain; give dimension=2")
        dofs = _thickness(dofs)
    elif len(np.unique(dofs, axis=0)) < len(dofs):
        dofs, of = _layers(path, dofs, dimension, deck)
    paths = stiffness, stiffness.with_suffix(".mas") if mass is None else mass
    one, other = (_read(existing(path, cure), dofs) for path in paths)
    return Rows(one, other, of)


def _turning(path: Path, dofs: np.ndarray, deck: Deck | None, nodes: Nodes) -> np.ndarray:
    """Displacements of nodes that turn rigid bodies, as rotations of their reference nodes."""
    made = np.setdiff1d(dofs[:, 0], nodes.numbers)
    pairs = [] if deck is None else list(deck.rigid)
    # CalculiX numbers the nodes that it makes in the order of the rigid bodies.
    unnamed = [index for index, (_, turning) in enumerate(pairs) if turning is None]
    if len(made) != len(unnamed):
        raise wrong(
            path,
            0,
            f"{len(made)} nodes, such as {made[0] if len(made) else 'none'}, have no place, and "
            f"{len(unnamed)} rigid bodies of the deck no ROT NODE. Those that CalculiX makes turn "
            "rigid bodies, or places where shells or beams meet at an angle; give the input deck "
            "of this job as nodes, with a ROT NODE for each rigid body, and solid elements where "
            "shells or beams meet",
        )
    for index, number in zip(unnamed, made.tolist(), strict=True):
        pairs[index] = pairs[index][0], number
    numbered = dofs.copy()
    for node, turning in pairs:
        own = dofs[:, 0] == turning
        numbered[own, 0], numbered[own, 1] = node, dofs[own, 1] + 3
    return numbered


def _thickness(dofs: np.ndarray) -> np.ndarray:
    """Changes of thickness as modal coordinates: rigid motion in the plane leaves them at rest."""
    numbered, across = dofs.copy(), dofs[:, 1] == _THICKNESS
    numbered[across, 0] = dofs[:, 0].max() + 1 + np.arange(np.sum(across))
    numbered[across, 1] = 0
    return numbered


def _layers(
    path: Path, dofs: np.ndarray, dimension: int, deck: Deck | None
) -> tuple[np.ndarray, np.ndarray]:
    """Degrees of freedom by nodes of layers, from 1, and the number in the deck of each."""
    again = "the directions of a node come again, as where shells, beams or plane elements are"
    if dimension == 2:
        known = "give the input deck as nodes" if deck is None else "mesh it by CPS or CPE elements"
        raise wrong(
            path,
            0,
            f"{again} expanded; for a body in the plane {known}, or give dimension=3",
        )
    node = np.cumsum((dofs[:, 1] == 1) | (np.diff(dofs[:, 0], prepend=-1) != 0))
    whole_nodes = np.bincount(node)[1:] == 3
    if not np.all(whole_nodes) or np.any(dofs[:, 1] > 3):
        number = dofs[np.flatnonzero(node == 1 + np.argmin(whole_nodes))[0], 0]
        raise wrong(
            path,
            0,
            f"{again} expanded, but layers of node {number} do not have three each; take "
            "supports, equations, rigid bodies and trusses out of the model, or mesh the body by "
            "solid elements",
        )
    return np.stack([node, dofs[:, 1]], axis=1), dofs[dofs[:, 1] == 1, 0]


def _dofs(path: Path) -> np.ndarray:
    """Node and direction of each row, written as node.direction, (rows, 2)."""
    pairs = []
    for line, row in data_lines(path, _COMMENT):
        node, _, direction = row.strip().partition(".")
        if not (node.isdigit() and direction.isdigit()):
            raise wrong(path, line, f"{row.strip()!r} is not node.direction; write it again")
        pairs.append((int(node), int(direction)))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _read(path: Path, dofs: np.ndarray) -> Entries:
    numbers = table(path, 3, None, _COMMENT)
    ids = whole(path, numbers[:, :2], _COMMENT)
    lines = np.array([line for line, _ in data_lines(path, _COMMENT)])
    outside = np.any((ids < 1) | (ids > len(dofs)), axis=1)
    if np.any(outside):
        line = int(lines[np.argmax(outside)])
        raise wrong(
            path,
            line,
            f"row or column {ids[np.argmax(outside)].max()}, but the file .dof beside it has "
            f"{len(dofs)}; take both from one job",
        )
    return Entries(path, dofs[ids[:, 0] - 1], dofs[ids[:, 1] - 1], numbers[:, 2], lines, modal=True)
