"""Matrices of Abaqus: *MATRIX GENERATE, in the formats MATRIX INPUT and COORDINATE."""

from pathlib import Path

import numpy as np

from .entries import Entries, data_lines, existing, table, whole, wrong
from .numbered import Degrees

_COMMENT = "*"  # keywords and comments alike


def read(stiffness: Path, mass: Path | None, degrees: Degrees) -> tuple[Entries, Entries]:
    """Read both matrices; the file of the mass is beside the stiffness unless given.

    MATRIX INPUT has rows of node, component, node, component and value, with commas; COORDINATE
    rows of row, column and value, and `degrees` says what the rows are.
    """
    if mass is None:
        mass = stiffness.with_name(stiffness.name.replace("STIF", "MASS"))
        if mass == stiffness:
            raise wrong(stiffness, 0, "the mass matrix is in a file of its own; give mass=…")
    return _read(stiffness, degrees), _read(mass, degrees)


def _read(path: Path, degrees: Degrees) -> Entries:
    lines = data_lines(existing(path, "write it by *MATRIX OUTPUT"), _COMMENT)
    first = lines[0][1] if lines else ""
    if first.startswith("%%MatrixMarket"):
        raise wrong(path, 1, "is of Matrix Market; ModalBody.of_mesh takes its name as it is")
    at = np.array([line for line, _ in lines])
    if "," in first:
        numbers = table(path, 5, ",", _COMMENT)
        ids = whole(path, numbers[:, :4], _COMMENT)
        return Entries(path, ids[:, :2], ids[:, 2:], numbers[:, 4], at)
    numbers = table(path, 3, None, _COMMENT)
    ids = whole(path, numbers[:, :2], _COMMENT)
    size = int(ids.max())
    return Entries(path, *degrees.of(path, ids, size), numbers[:, 2], at, modal=True)
