"""From a mesh with its matrices to modes, inertia invariants and shapes at ports."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...arrays import Vector
from ...errors import SceneError
from .component_modes import Matrix, checked, craig_bampton, free_interface, ritz
from .inertia import Inertia
from .mesh_checks import check_nodes
from .mesh_inertia import planar_inertia, spatial_inertia
from .mesh_outline import outline
from .spatial.inertia import SpatialInertia
from .spatial.products import turned

# Rigid motions have the frequencies that rounding of their stiffness leaves; up to this share of
# the first elastic frequency is accepted.
RIGID = 1e-2


class ReducedMesh(NamedTuple):
    """What a body uses of a mesh."""

    frequencies: np.ndarray  # ω [rad/s], (modes,)
    inertia: Inertia | SpatialInertia
    points: np.ndarray  # of the ports, then of the outline, (points, d)
    shapes: np.ndarray  # (points, 3 | 6, modes)


def reduce_mesh(
    owner: str,
    dimension: int,
    stiffness: Matrix,
    mass: Matrix,
    nodes: Vector,
    ports: Mapping[str, Vector],
    modes: int,
    interface: str,
    dofs: Vector | None,
) -> ReducedMesh:
    """Modes of a free mesh whose ports are rigid, and all that its motion needs of them.

    The arguments are those of `ModalBody.of_mesh`; `owner` is what messages call the body, and
    `dimension` 2 in the plane, 3 in space.
    """
    k, m = checked(_matrix(owner, stiffness), _matrix(owner, mass))
    positions = np.asarray(nodes, float)
    rows = _layout(owner, dimension, k.shape[0], positions, dofs)
    free = 3 if dimension == 2 else 6  # rigid motions of a body, or of a port
    pins = {port: np.atleast_1d(np.asarray(of, int)) for port, of in ports.items()}
    if not pins:
        raise SceneError(f"{owner}: it has no ports; give the nodes where joints and effects act.")
    check_nodes(owner, k, m, positions, rows)
    centres, tie = _tie(owner, positions, rows, pins)
    tied = tie.T @ k @ tie, tie.T @ m @ tie
    held = tied[0].shape[0] - free * len(pins) + np.arange(free * len(pins))
    if interface == "fixed":
        component = craig_bampton(*tied, held, modes)
    elif interface == "free":
        component = free_interface(*tied, modes + free)
    else:
        raise SceneError(f"{owner}: interface is {interface!r}, but it must be 'fixed' or 'free'.")
    if len(component.frequencies) <= free:
        raise SceneError(f"{owner}: no elastic mode is kept; give modes=1 or more.")
    low, high = component.frequencies[free - 1 : free + 1]
    if not low < RIGID * high:
        words = ("third", "fourth", "three") if dimension == 2 else ("sixth", "seventh", "six")
        raise SceneError(
            f"{owner}: its {words[0]} frequency is {low:g} rad/s, its {words[1]} {high:g}; a free "
            f"body has {words[2]} rigid motions. Take the supports out of K, and connect all nodes."
        )
    # Rigid motions are exact by geometry; elastic modes are made orthogonal to them to rounding.
    rigid = np.zeros((k.shape[0], free))
    rigid[rows.ravel()] = _rigid(positions, rows)
    elastic = tie @ component.modes[:, free:]
    elastic -= rigid @ np.linalg.solve(rigid.T @ (m @ rigid), rigid.T @ (m @ elastic))
    frequencies, elastic = ritz(k, m, elastic)
    hull = outline(positions)
    drawn = np.zeros((len(hull), free, elastic.shape[1]))
    drawn[:, :dimension] = elastic[rows[hull, :dimension]]
    pinned = [
        _follow(positions, rows, pin, c, elastic)
        for pin, c in zip(pins.values(), centres, strict=True)
    ]
    inertia = planar_inertia if dimension == 2 else spatial_inertia
    return ReducedMesh(
        frequencies,
        inertia(positions, rows, m, rigid, elastic),
        np.concatenate([centres, positions[hull]]),
        np.concatenate([*(shape[None] for shape in pinned), drawn]),
    )


def _matrix(owner: str, given: Matrix | str | Path) -> Matrix:
    """The matrix, read from its file if it is the name of one."""
    if not isinstance(given, str | Path):
        return given
    import scipy.io  # here, since few ask for it

    try:
        return sp.load_npz(given) if Path(given).suffix == ".npz" else scipy.io.mmread(given)
    except (OSError, ValueError) as error:
        raise SceneError(
            f"{owner}: {given} is no Matrix Market file, and no sparse matrix of SciPy ({error}); "
            "romjax.load_mesh reads those of Abaqus, CalculiX and Nastran."
        ) from error


def _layout(
    owner: str, dimension: int, n: int, positions: np.ndarray, dofs: Vector | None
) -> np.ndarray:
    """Rows of the nodes in the matrices (nodes, 2 or 3 in the plane, 3 or 6 in space)."""
    if positions.ndim != 2 or positions.shape[1] != dimension or not np.all(np.isfinite(positions)):
        raise SceneError(
            f"{owner}: nodes must be finite and (nodes, {dimension}), not {positions.shape}."
        )
    nodes, widths = len(positions), (2, 3) if dimension == 2 else (3, 6)
    each = n // nodes
    rows = np.arange(each * nodes).reshape(nodes, each) if dofs is None else np.asarray(dofs, int)
    fits = rows.shape in [(nodes, width) for width in widths]
    if not fits or not np.array_equal(np.sort(rows, axis=None), np.arange(n)):
        own = "its x, its y or its rotation" if dimension == 2 else "a displacement or a rotation"
        raise SceneError(
            f"{owner}: {nodes} nodes and matrices of {n} rows; every row must belong to one node, "
            f"as {own}. Give dofs, (nodes, {widths[0]}) or (nodes, {widths[1]})."
        )
    return rows


def _tie(
    owner: str, positions: np.ndarray, rows: np.ndarray, ports: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, Matrix]:
    """Centres of the ports, and the rows of the mesh by the free ones and the rigid motions of each
    port.
    """
    n, taken = rows.size, np.zeros(rows.size, bool)
    centres, blocks = np.zeros((len(ports), positions.shape[1])), []
    for index, (port, nodes) in enumerate(ports.items()):
        if not nodes.size or nodes.min() < 0 or nodes.max() >= len(positions):
            raise SceneError(
                f"{owner}: port '{port}' has the nodes {nodes.tolist()}; the mesh has nodes 0 to "
                f"{len(positions) - 1}."
            )
        own = rows[nodes].ravel()
        if np.any(taken[own]):
            raise SceneError(f"{owner}: port '{port}' shares nodes with another one.")
        taken[own] = True
        centres[index] = positions[nodes].mean(axis=0)
        motion = _rigid(positions[nodes] - centres[index][None], rows[nodes])
        width = motion.shape[1]
        if np.linalg.matrix_rank(motion, 1e-9 * np.max(abs(motion))) < width:
            what, remedy = ("one point", "a rim or an edge, two or more")
            if width == 6:
                what, remedy = ("on one line", "a rim or a face, three or more")
            raise SceneError(
                f"{owner}: port '{port}' is {what} of a mesh without rotations; give the nodes of "
                f"{remedy}."
            )
        across = np.broadcast_to(width * index + np.arange(width), motion.shape)
        blocks.append((motion, np.broadcast_to(own[:, None], motion.shape), across))
    free = np.flatnonzero(~taken)
    columns = [b[2] + len(free) for b in blocks]
    entries = np.concatenate([np.ones(len(free)), *(b[0].ravel() for b in blocks)])
    down = np.concatenate([free, *(b[1].ravel() for b in blocks)])
    along = np.concatenate([np.arange(len(free)), *(c.ravel() for c in columns)])
    shape = (n, len(free) + width * len(ports))
    return centres, sp.csc_array((entries, (down, along)), shape=shape)


def _rigid(positions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Displacements of nodes, in the order of `rows`, by unit motions of the origin: along the
    axes, then about z in the plane, about all of them in space.
    """
    d = positions.shape[1]
    around = turned(positions) if d == 3 else np.stack([-positions[:, 1:], positions[:, :1]], 1)
    motion = np.zeros((*rows.shape, d + around.shape[2]))
    motion[:, :d, :d], motion[:, :d, d:] = np.eye(d), around
    motion[:, d:, d:] = np.eye(around.shape[2])[: rows.shape[1] - d]
    return motion.reshape(-1, motion.shape[2])


def _follow(
    positions: np.ndarray,
    rows: np.ndarray,
    nodes: np.ndarray,
    centre: np.ndarray,
    elastic: np.ndarray,
) -> np.ndarray:
    """Motion of a rigid port per unit amplitude, (3, modes)."""
    motion = _rigid(positions[nodes] - centre[None], rows[nodes])
    pinned: np.ndarray = np.linalg.lstsq(motion, elastic[rows[nodes].ravel()])[0]
    return pinned
