"""Matrices of Nastran: DMIG entries in punch files, and OUTPUT4 files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...common.extras import extra
from .cards import Card, cards
from .entries import Entries, existing, wrong
from .numbered import Degrees

_SQUARE = (1, 6)
# A column entry has its name, its node and component, and a field that is empty; then four fields
# for each row: node, component, real and imaginary part.
_HEAD, _ROW = 4, 4


def read_punch(
    path: Path, mass: Path | None, names: Sequence[str] | None
) -> tuple[Entries, Entries]:
    """Stiffness and mass in one file, or in two, by their `names`, or by the letters K and M."""
    matrices: dict[str, list[Card]] = {}
    files: dict[str, Path] = {}
    for file in (path,) if mass is None else (path, mass):
        for card in cards(existing(file, "write it by EXTSEOUT or PARAM,EXTOUT,DMIGPCH"), "DMIG"):
            name = card.field(0).upper()
            if files.setdefault(name, file) != file:
                raise wrong(file, card.lines[0], f"{name} is in {path} too; give one of both")
            matrices.setdefault(name, []).append(card)
    one, other = (_entries(files[name], matrices[name]) for name in _chosen(path, matrices, names))
    return one, other


def _entries(path: Path, columns: list[Card]) -> Entries:
    headers = [card for card in columns if card.field(1) == "0"]
    if not headers:
        raise wrong(path, columns[0].lines[0], f"no header DMIG,{columns[0].field(0)},0; add it")
    header = headers[0]
    if header.integer(path, 2) not in _SQUARE or header.integer(path, 3) > 2:
        raise wrong(
            path,
            header.lines[0],
            f"form {header.field(2)}, type {header.field(3)} of {header.field(0)}, but a matrix "
            "must be square (1 or 6) and real (1 or 2); write such a one",
        )
    rows, values, lines = [], [], []
    for card in columns:
        if card.field(1) == "0":
            continue
        column = card.integer(path, 1), card.integer(path, 2, 0)
        for at in range(_HEAD, len(card.fields), _ROW):
            if card.field(at):
                rows.append((card.integer(path, at), card.integer(path, at + 1, 0), *column))
                values.append(card.real(path, at + 2))
                lines.append(card.lines[at])
    degrees = np.array(rows, np.int64).reshape(-1, 4)
    # Scalar points have no component: the modal coordinates of a reduced body.
    numbers = np.array(values), np.array(lines, int)
    return Entries(path, degrees[:, :2], degrees[:, 2:], *numbers, modal=True)


def read_op4(
    path: Path, mass: Path | None, names: Sequence[str] | None, degrees: Degrees
) -> tuple[Entries, Entries]:
    """Stiffness and mass in one OUTPUT4 file, text or binary, or in two (extra `nastran`)."""
    instead = "or write DMIG entries to a punch file, which need no package"
    op4 = extra("load_mesh", "pyNastran.op4.op4", "nastran", instead)
    known: dict[str, tuple[Path, Any]] = {}
    for file in (path,) if mass is None else (path, mass):
        existing(file, "write it by OUTPUT4")
        try:
            matrices = op4.OP4(debug=None).read_op4(str(file))
        except Exception as error:  # whatever a broken file makes the package do
            words = str(error).split("\n")[0]
            raise wrong(file, 0, f"is no OUTPUT4 file ({words}); write it again") from error
        known |= {name.upper(): (file, matrix) for name, matrix in matrices.items()}
    one, other = (_coordinates(*known[x], degrees) for x in _chosen(path, known, names))
    return one, other


def _coordinates(path: Path, matrix: Any, degrees: Degrees) -> Entries:
    # A pair of form and data in older versions of the package.
    data = matrix[1] if isinstance(matrix, tuple) else matrix.data
    entries = sp.coo_array(data)
    ids = np.stack([entries.row, entries.col], axis=1) + 1
    rows, columns = degrees.of(path, ids, entries.shape[0])
    return Entries(path, rows, columns, entries.data, np.zeros(len(ids), int), modal=True)


def _chosen(
    path: Path, matrices: Mapping[str, Any], names: Sequence[str] | None
) -> tuple[str, str]:
    """The names of stiffness and mass among those that were found."""
    listed = ", ".join(matrices) or "none"
    if names is not None:
        stiffness, mass = (name.upper() for name in names)
        if stiffness not in matrices or mass not in matrices:
            raise wrong(path, 0, f"has no {stiffness} or {mass}; it has the matrices {listed}")
        return stiffness, mass
    chosen = [[name for name in matrices if name.startswith(letter)] for letter in "KM"]
    if any(len(candidates) != 1 for candidates in chosen):
        raise wrong(
            path, 0, f"has the matrices {listed}; give names=(…, …) of the stiffness and the mass"
        )
    return chosen[0][0], chosen[1][0]
