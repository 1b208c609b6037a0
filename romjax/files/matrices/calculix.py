"""Matrices of CalculiX: *FREQUENCY, SOLVER=MATRIXSTORAGE, files .sti, .mas and .dof."""

from pathlib import Path

import numpy as np

from .entries import Entries, data_lines, existing, table, whole, wrong

_COMMENT = "*"  # there is none


def read(stiffness: Path, mass: Path | None) -> tuple[Entries, Entries]:
    """Both matrices; the mass is beside the stiffness unless given, as is what the rows are."""
    cure = "run a step *FREQUENCY with SOLVER=MATRIXSTORAGE"
    dofs = _dofs(existing(stiffness.with_suffix(".dof"), cure))
    paths = stiffness, stiffness.with_suffix(".mas") if mass is None else mass
    one, other = (_read(existing(path, cure), dofs) for path in paths)
    return one, other


def _dofs(path: Path) -> np.ndarray:
    """Node and direction of each row, written as node.direction, (rows, 2)."""
    found = []
    for line, row in data_lines(path, _COMMENT):
        node, _, direction = row.strip().partition(".")
        if not (node.isdigit() and direction.isdigit()):
            raise wrong(path, line, f"{row.strip()!r} is not node.direction; write it again")
        found.append((int(node), int(direction)))
    return np.array(found, np.int64).reshape(-1, 2)


def _read(path: Path, dofs: np.ndarray) -> Entries:
    numbers = table(path, 3, None, _COMMENT)
    ids = whole(path, numbers[:, :2], _COMMENT)
    places = np.array([line for line, _ in data_lines(path, _COMMENT)])
    outside = np.any((ids < 1) | (ids > len(dofs)), axis=1)
    if np.any(outside):
        line = int(places[np.argmax(outside)])
        raise wrong(
            path,
            line,
            f"row or column {ids[np.argmax(outside)].max()}, but the file .dof beside it has "
            f"{len(dofs)}; take both from one job",
        )
    return Entries(path, dofs[ids[:, 0] - 1], dofs[ids[:, 1] - 1], numbers[:, 2], places)
