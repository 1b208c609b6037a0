"""Meshes from the matrix files of finite-element programs."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...common.arrays import Vector
from ...common.errors import InputError
from . import abaqus, calculix, nastran
from .deck import deck_of
from .entries import COMPONENTS, Entries, code, decode, wrong
from .layers import layer_positions
from .nodes import Nodes, nodes_of
from .numbered import Degrees

PathLike = str | os.PathLike[str]

# Entries smaller than this share of the largest one couple nothing: rounding.
_ROUNDING = 1e-12
_PUNCH = (".pch", ".bdf", ".dat", ".nas")
# Components in a plane mesh and in space: displacements, rotations, and those that are left out.
_COMPONENTS = {2: ((1, 2), (6,), (3, 4, 5)), 3: ((1, 2, 3), (4, 5, 6), ())}


class Mesh(NamedTuple):
    """A mesh as `ModalBody.of_mesh` takes it, in the plane or in space.

    - `stiffness`, `mass`: K and M (n, n), sparse and whole. `nodes` (nodes, 2 or 3) [m].
    - `dofs`: rows of the displacements of each along x and y and of its rotation, (nodes, 2 or 3);
      in space of three displacements and three rotations, (nodes, 3 or 6); −1 for the rotations of
      nodes without. Rows in none of them are modal coordinates of a body that is reduced already.
    - `numbers` (nodes,): those that the nodes have in the program, rising; the same for all layers
      to which CalculiX expands a node of shells and beams.
    """

    stiffness: sp.csc_array
    mass: sp.csc_array
    nodes: np.ndarray
    dofs: np.ndarray
    numbers: np.ndarray

    def at(self, *numbers: int) -> np.ndarray:
        """Return the indices in `nodes` of nodes by their `numbers`, all layers of each, for ports.

        Raises InputError for a number that the mesh does not have.
        """
        missing = ~np.isin(numbers, self.numbers)
        if np.any(missing):
            raise InputError(
                f"Mesh.at: there is no node {numbers[np.argmax(missing)]}; numbers are from "
                f"{self.numbers.min()} to {self.numbers.max()}."
            )
        return np.concatenate([np.flatnonzero(self.numbers == number) for number in numbers])


def load_mesh(
    stiffness: PathLike,
    mass: PathLike | None = None,
    nodes: PathLike | Mapping[int, Vector] | Vector | None = None,
    *,
    dimension: int = 2,
    names: Sequence[str] | None = None,
    components: Sequence[int] | None = None,
) -> Mesh:
    """The matrices of a mesh from the files of a finite-element program, for `ModalBody.of_mesh`,
    free of supports and in SI units.

    - Abaqus, `.mtx` of *MATRIX GENERATE, in the formats MATRIX INPUT and COORDINATE.
    - CalculiX, `.sti` of *FREQUENCY, SOLVER=MATRIXSTORAGE, with `.mas` and `.dof` beside it. With
      the input deck as nodes also shells and beams, by the layers of nodes to which they are
      expanded, plane stress and strain, and rigid bodies with their rotations.
    - Nastran, DMIG entries in a punch file (`.pch` or bulk data), or OUTPUT4 (`.op4`, extra
      `nastran`), both matrices in one, or in two.

    A plane mesh lies in x–y. What moves across it, z and the rotations about x and y, is left out
    where nothing couples it to the plane, and refused elsewhere. Rotations of nodes without
    stiffness and mass are left out. Lower, upper and whole matrices are read alike. Scalar points
    in DMIG entries are modal coordinates of a body that is reduced already.

    **Arguments:**

    - `stiffness`: the file. `mass`: that of the mass; unless given beside it, with STIF replaced
      by MASS, or .sti by .mas, of Nastran the same.
    - `nodes`: their places [m]: an input deck (`.inp` with *NODE), bulk data with GRID, a text file
      of number, x, y, an array in the order of rising numbers from 1, or a mapping from numbers;
      for a punch file, the file itself unless given.
    - `dimension`: 2 of a plane mesh, 3 of a solid or a shell, for `romjax.spatial.ModalBody`.
    - `names`: of the matrices in Nastran's files, such as ("KAAX", "MAAX"); the one that begins
      with K and the one with M unless given.
    - `components`: of each node, where a file only numbers its rows (COORDINATE, OUTPUT4), such as
      (1, 2, 6); nodes by rising number, then modal coordinates, if more rows are there.

    Raises InputError for a file that is wrong, with file, line, cause and cure; ImportError, with
    what to install, for OUTPUT4 without the extra.
    """
    if dimension not in _COMPONENTS:
        raise InputError(f"load_mesh: dimension is {dimension}, but it must be 2 or 3.")
    path, other = Path(stiffness), None if mass is None else Path(mass)
    kind = path.suffix.lower()
    if nodes is None:
        if kind not in _PUNCH:
            raise InputError(
                f"load_mesh: {path} has no places of nodes; give nodes=…, such as the input deck."
            )
        nodes = path
    known = nodes_of(nodes)
    degrees = Degrees(known.numbers, components, dimension)
    if kind == ".mtx":
        return _mesh(dimension, *abaqus.read(path, other, degrees), known)
    if kind == ".sti":
        deck = deck_of(Path(nodes)) if isinstance(nodes, str | os.PathLike) else None
        return _of_calculix(dimension, calculix.read(path, other, deck, known, dimension), known)
    if kind in _PUNCH:
        return _mesh(dimension, *nastran.read_punch(path, other, names), known)
    if kind == ".op4":
        return _mesh(dimension, *nastran.read_op4(path, other, names, degrees), known)
    raise InputError(
        f"load_mesh: {path} is no .mtx, .sti, .pch, .bdf, .dat, .nas or .op4; give a file of "
        "Abaqus, CalculiX or Nastran by its ending."
    )


def _of_calculix(dimension: int, rows: calculix.Rows, nodes: Nodes) -> Mesh:
    """A mesh whose nodes may stand for layers, which then have positions of their own."""
    stiffness, mass, of = rows
    if of is None:
        return _mesh(dimension, stiffness, mass, nodes)
    numbers, node = np.unique(of, return_inverse=True)
    means = _positions(dimension, stiffness, nodes, numbers)
    index = np.arange(1, len(of) + 1)
    mesh = _mesh(dimension, stiffness, mass, Nodes(index, means[node]))
    layers = layer_positions(stiffness.path, mesh.stiffness, mesh.mass, means, node)
    return mesh._replace(nodes=layers, numbers=of)


def _mesh(dimension: int, stiffness: Entries, mass: Entries, nodes: Nodes) -> Mesh:
    """The part of both matrices that moves in the plane or in space, and its nodes."""
    moves, turning, left_out = _COMPONENTS[dimension]
    known = np.unique(np.concatenate([*stiffness.codes(), *mass.codes()]))
    k, m = stiffness.matrix(known), mass.matrix(known)
    degrees = decode(known)
    across = np.isin(degrees[:, 1], left_out)
    for entries, matrix in ((stiffness, k), (mass, m)):
        _check_across(entries, matrix, degrees, across)
    across |= _idle(degrees, turning, abs(k).sum(axis=1) + abs(m).sum(axis=1))
    kept = np.flatnonzero(~across)
    degrees = degrees[kept]
    numbers = np.unique(degrees[degrees[:, 1] > 0, 0])
    wanted = (*moves, *turning) if np.any(np.isin(degrees[:, 1], turning)) else moves
    return Mesh(
        k[kept][:, kept],
        m[kept][:, kept],
        _positions(dimension, stiffness, nodes, numbers),
        _dofs(stiffness, degrees, numbers, wanted, len(moves)),
        numbers,
    )


def _idle(degrees: np.ndarray, turning: tuple[int, ...], size: np.ndarray) -> np.ndarray:
    """The rotations of nodes of which none has stiffness or mass, as of membranes and solids."""
    turns = np.isin(degrees[:, 1], turning)
    working = np.unique(degrees[turns & (size > 0), 0])
    idle: np.ndarray = turns & ~np.isin(degrees[:, 0], working)
    return idle


def _check_across(
    entries: Entries, matrix: sp.csc_array, degrees: np.ndarray, across: np.ndarray
) -> None:
    """Raise InputError where a motion across the plane is coupled to one within."""
    between = abs(matrix[~across][:, across]).tocoo()
    if between.nnz == 0:
        return
    worst = int(np.argmax(between.data))
    if between.data[worst] > _ROUNDING * abs(matrix).max():
        (one, a), (other, b) = (
            degrees[~across][between.row[worst]],
            degrees[across][between.col[worst]],
        )
        raise wrong(
            entries.path,
            0,
            f"{COMPONENTS[a - 1]} of node {one} is coupled to {COMPONENTS[b - 1]} of node {other}, "
            "across the plane x–y; mesh the body in this plane, by plane or shell elements, of "
            "CalculiX by CPS or CPE, and give the input deck as nodes, which says so",
        )


def _dofs(
    entries: Entries,
    degrees: np.ndarray,
    numbers: np.ndarray,
    wanted: tuple[int, ...],
    moves: int,
) -> np.ndarray:
    """Rows of each node, (nodes, wanted), −1 for the rotations of nodes without.

    Raises InputError for displacements that are missing, and for some of several rotations.
    """
    asked = np.stack(
        [np.repeat(numbers, len(wanted)), np.tile(np.array(wanted), len(numbers))], axis=1
    )
    codes = code(degrees)
    rows = np.minimum(np.searchsorted(codes, code(asked)), len(codes) - 1)
    rows = np.where(codes[rows] == code(asked), rows, -1).reshape(len(numbers), -1)
    needed = np.any(rows[:, moves:] >= 0, axis=1)
    missing = rows < 0
    missing[~needed, moves:] = False
    if np.any(missing):
        number, component = asked[np.argmax(missing)]
        raise wrong(
            entries.path,
            0,
            f"node {number} has no row for {COMPONENTS[component - 1]}, but others have; take "
            "supports out of the model, and give all nodes the same components, or no rotations",
        )
    return rows


def _positions(dimension: int, entries: Entries, nodes: Nodes, numbers: np.ndarray) -> np.ndarray:
    """Positions of the nodes of the matrices; those of a plane mesh must have the same z."""
    missing = np.setdiff1d(numbers, nodes.numbers)
    if len(missing):
        raise wrong(
            entries.path,
            0,
            f"{len(missing)} nodes, such as {missing[0]}, have no place; give those of this model",
        )
    positions = nodes.positions[np.searchsorted(nodes.numbers, numbers)]
    if dimension == 2 and np.ptp(positions[:, 2]) > _ROUNDING * np.max(np.ptp(positions, axis=0)):
        raise wrong(
            entries.path,
            0,
            f"the nodes lie between z = {positions[:, 2].min():g} and {positions[:, 2].max():g} m; "
            "mesh the body in a plane of constant z, or give dimension=3",
        )
    columns: np.ndarray = positions[:, :dimension]
    return columns
