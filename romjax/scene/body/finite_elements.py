"""From a plane mesh with its matrices to modes, inertia invariants and shapes at ports."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...arrays import Vector
from ...errors import SceneError
from .component_modes import Matrix, checked, craig_bampton, free_interface, ritz
from .inertia import Inertia

# Inertia terms smaller than this share of their natural size are rounding; the program of the
# dynamics has no code for them.
ROUNDING = 1e-10
# Rigid motions have the frequencies that rounding of their stiffness leaves; up to this share of
# the first elastic frequency is accepted.
RIGID = 1e-2


class ReducedMesh(NamedTuple):
    """What a body uses of a mesh."""

    frequencies: np.ndarray  # ω [rad/s], (modes,)
    inertia: Inertia
    points: np.ndarray  # of the ports, then of the convex hull, (points, 2)
    shapes: np.ndarray  # (points, 3, modes)


def reduce_mesh(
    owner: str,
    stiffness: Matrix,
    mass: Matrix,
    nodes: Vector,
    ports: Mapping[str, Vector],
    modes: int,
    interface: str,
    dofs: Vector | None,
) -> ReducedMesh:
    """Modes of a free mesh whose ports are rigid, and all that its motion needs of them.

    The arguments are those of `ModalBody.of_mesh`; `owner` is what messages call the body.
    """
    k, m = checked(_matrix(owner, stiffness), _matrix(owner, mass))
    positions, rows = _layout(owner, k.shape[0], np.asarray(nodes, float), dofs)
    pins = {port: np.atleast_1d(np.asarray(of, int)) for port, of in ports.items()}
    if not pins:
        raise SceneError(f"{owner}: it has no ports; give the nodes where joints and effects act.")
    centres, tie = _tie(owner, positions, rows, pins)
    tied = tie.T @ k @ tie, tie.T @ m @ tie
    held = tied[0].shape[0] - 3 * len(pins) + np.arange(3 * len(pins))
    if interface == "fixed":
        component = craig_bampton(*tied, held, modes)
    elif interface == "free":
        component = free_interface(*tied, modes + 3)
    else:
        raise SceneError(f"{owner}: interface is {interface!r}, but it must be 'fixed' or 'free'.")
    if len(component.frequencies) < 4:
        raise SceneError(f"{owner}: no elastic mode is kept; give modes=1 or more.")
    low, high = component.frequencies[2:4]
    if not low < RIGID * high:
        raise SceneError(
            f"{owner}: its third frequency is {low:g} rad/s, its fourth {high:g}; a free plane "
            "body has three rigid motions. Take the supports out of K, and connect all nodes."
        )
    # Rigid motions are exact by geometry; elastic modes are made orthogonal to them to rounding.
    rigid = np.zeros((k.shape[0], 3))
    rigid[rows.ravel()] = _rigid(positions, rows)
    elastic = tie @ component.modes[:, 3:]
    elastic -= rigid @ np.linalg.solve(rigid.T @ (m @ rigid), rigid.T @ (m @ elastic))
    frequencies, elastic = ritz(k, m, elastic)
    hull = _outline(positions)
    drawn = np.zeros((len(hull), 3, elastic.shape[1]))
    drawn[:, :2] = elastic[rows[hull, :2]]
    pinned = [
        _follow(positions, rows, pin, c, elastic)
        for pin, c in zip(pins.values(), centres, strict=True)
    ]
    return ReducedMesh(
        frequencies,
        _inertia(positions, rows, m, elastic),
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
    owner: str, n: int, positions: np.ndarray, dofs: Vector | None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the nodes (nodes, 2) and their rows in the matrices (nodes, 2 or 3)."""
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.all(np.isfinite(positions)):
        raise SceneError(f"{owner}: nodes must be finite and (nodes, 2), not {positions.shape}.")
    each = n // len(positions)
    rows = np.arange(each * len(positions)).reshape(len(positions), each) if dofs is None else dofs
    rows = np.asarray(rows, int)
    if rows.shape not in ((len(positions), 2), (len(positions), 3)) or set(rows.flat) != set(
        range(n)
    ):
        raise SceneError(
            f"{owner}: {len(positions)} nodes and matrices of {n} rows; every row must belong to "
            "one node, as its x, its y or its rotation. Give dofs, (nodes, 2) or (nodes, 3)."
        )
    return positions, rows


def _tie(
    owner: str, positions: np.ndarray, rows: np.ndarray, ports: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, Matrix]:
    """Centres of the ports, and the rows of the mesh by the free ones and x, y, φ of each port."""
    n, taken = rows.size, np.zeros(rows.size, bool)
    centres, blocks = np.zeros((len(ports), 2)), []
    for index, (port, nodes) in enumerate(ports.items()):
        if not nodes.size or nodes.min() < 0 or nodes.max() >= len(positions):
            raise SceneError(
                f"{owner}: port '{port}' has the nodes {nodes.tolist()}; the mesh has nodes 0 to "
                f"{len(positions) - 1}."
            )
        if rows.shape[1] == 2 and not np.any(np.ptp(positions[nodes], axis=0)):
            raise SceneError(
                f"{owner}: port '{port}' is one point of a mesh without rotations; give the nodes "
                "of a rim or an edge, two or more."
            )
        own = rows[nodes].ravel()
        if np.any(taken[own]):
            raise SceneError(f"{owner}: port '{port}' shares nodes with another one.")
        taken[own] = True
        centres[index] = positions[nodes].mean(axis=0)
        motion = _rigid(positions[nodes] - centres[index][None], rows[nodes])
        across = np.broadcast_to(3 * index + np.arange(3), motion.shape)
        blocks.append((motion, np.broadcast_to(own[:, None], motion.shape), across))
    free = np.flatnonzero(~taken)
    columns = [b[2] + len(free) for b in blocks]
    entries = np.concatenate([np.ones(len(free)), *(b[0].ravel() for b in blocks)])
    down = np.concatenate([free, *(b[1].ravel() for b in blocks)])
    along = np.concatenate([np.arange(len(free)), *(c.ravel() for c in columns)])
    return centres, sp.csc_array((entries, (down, along)), shape=(n, len(free) + 3 * len(ports)))


def _rigid(positions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Displacements of nodes, in the order of `rows`, by unit motions in x, y, φ of the origin."""
    motion = np.zeros((*rows.shape, 3))
    motion[:, 0, 0] = motion[:, 1, 1] = 1
    motion[:, 0, 2], motion[:, 1, 2] = -positions[:, 1], positions[:, 0]
    motion[:, 2:, 2] = 1
    return motion.reshape(-1, 3)


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


def _inertia(positions: np.ndarray, rows: np.ndarray, mass: Matrix, elastic: np.ndarray) -> Inertia:
    """The invariants as products with the mass matrix: exact where X is in the mesh's own span."""
    n = mass.shape[0]
    rigid, radius, turned = np.zeros((n, 3)), np.zeros(n), np.zeros_like(elastic)
    rigid[rows.ravel()] = _rigid(positions, rows)
    radius[rows[:, 0]], radius[rows[:, 1]] = positions.T
    turned[rows[:, 0]], turned[rows[:, 1]] = -elastic[rows[:, 1]], elastic[rows[:, 0]]
    total, moment = rigid[:, 0] @ (mass @ rigid[:, 0]), rigid[:, 2] @ (mass @ rigid[:, 2])
    terms = {
        "first_moment": (rigid[:, :2].T @ (mass @ radius), (total * moment) ** 0.5),
        "stretch": ((mass @ radius) @ elastic, moment**0.5),
        "gyration": (elastic.T @ (mass @ turned), 1.0),
    }
    nonzero = {name: x for name, (x, size) in terms.items() if np.any(abs(x) > ROUNDING * size)}
    return Inertia(total, moment, **nonzero)


def _outline(positions: np.ndarray) -> np.ndarray:
    """Nodes of the convex hull, closed; of a straight line, some of its nodes in order."""
    _, spread, axes = np.linalg.svd(positions - positions.mean(axis=0)[None], full_matrices=False)
    if spread[1] > ROUNDING * spread[0]:
        import scipy.spatial  # here, since it takes long to load and few ask for it

        hull = scipy.spatial.ConvexHull(positions).vertices
        return np.append(hull, hull[0])
    order: np.ndarray = np.argsort(positions @ axes[0])
    some: np.ndarray = order[np.unique(np.linspace(0, len(order) - 1, 41).astype(int))]
    return some
