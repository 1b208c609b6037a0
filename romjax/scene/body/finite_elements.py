"""Modes, inertia invariants and shapes at ports of a mesh with its matrices."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...common.arrays import Vector
from ...common.errors import SceneError
from ..fields import check_choice
from .component_modes import (
    ComponentModes,
    Matrix,
    checked,
    craig_bampton,
    free_interface,
    ritz,
    with_loads,
)
from .inertia import Inertia
from .mesh_checks import check_nodes
from .mesh_inertia import planar_inertia, slow_enough, spatial_inertia
from .mesh_outline import outline
from .mesh_ports import PortNodes, ports_of, tie
from .mesh_rows import rigid_motion, rows_of
from .spatial.inertia import SpatialInertia

# Rigid motions have the frequencies that rounding of their stiffness leaves; up to this share of
# the first elastic frequency is accepted.
RIGID = 1e-2


class ReducedMesh(NamedTuple):
    """A mesh reduced to what a body uses of it."""

    frequencies: np.ndarray  # ω [rad/s], (modes,)
    inertia: Inertia | SpatialInertia
    points: np.ndarray  # of the ports, then of the outline, (points, d)
    shapes: np.ndarray  # (points, 3 | 6, modes)
    unturned: tuple[str, ...]  # the ports whose rotation nothing says
    elastic: np.ndarray  # the modes by the rows of K, (n, modes)


def reduce_mesh(
    owner: str,
    dimension: int,
    stiffness: Matrix,
    mass: Matrix,
    nodes: Vector,
    ports: Mapping[str, PortNodes],
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
    rows = rows_of(owner, dimension, k.shape[0], positions, dofs)
    free = 3 if dimension == 2 else 6  # rigid motions of a body, or of a port
    check_nodes(owner, k, m, positions, rows)
    pins = ports_of(owner, ports, positions, rows)
    tied, held = tie(owner, pins, k.shape[0])
    rigid = np.zeros((k.shape[0], free))
    own = rows >= 0
    rigid[rows[own]] = rigid_motion(positions, own)
    shared = [port.loads(k.shape[0]) for port in pins if port.shares]
    loads = np.hstack([np.zeros((k.shape[0], 0)), *shared])
    component = _modes(owner, (k, m), tied, held, rigid, loads, modes, interface)
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
    elastic = tied @ component.modes[:, free:]
    elastic -= rigid @ np.linalg.solve(rigid.T @ (m @ rigid), rigid.T @ (m @ elastic))
    frequencies, elastic = ritz(k, m, elastic)
    if np.count_nonzero(own) < k.shape[0]:
        slow = slow_enough(dimension, rows, m, frequencies, elastic)
        if slow < frequencies[0]:  # none turns faster whose deflections are small
            warnings.warn(
                f"{owner}: it is reduced already, to nodes and modal coordinates. Where its parts "
                "are between nodes is not in the matrices, so that centrifugal and gyroscopic "
                f"forces on its deflection are estimates: turning faster than about {slow:.2g} "
                "rad/s changes frequencies by more than a hundredth in other ways than it should. "
                "Give the matrices of the whole mesh for that.",
                stacklevel=4,
            )
    hull = outline(positions)
    drawn = np.zeros((len(hull), free, elastic.shape[1]))
    drawn[:, :dimension] = elastic[rows[hull, :dimension]]
    inertia = planar_inertia if dimension == 2 else spatial_inertia
    return ReducedMesh(
        frequencies,
        inertia(positions, rows, m, rigid, elastic),
        np.concatenate([*(port.centre[None] for port in pins), positions[hull]]),
        np.concatenate([*(port.follow(elastic)[None] for port in pins), drawn]),
        tuple(port.name for port in pins if not port.turns),
        elastic,
    )


def _modes(
    owner: str,
    matrices: tuple[Matrix, Matrix],
    tied: Matrix,
    held: np.ndarray,
    rigid: np.ndarray,
    loads: np.ndarray,
    modes: int,
    interface: str,
) -> ComponentModes:
    """Modes of the mesh with its rigid ports, by the rows that `tied` leaves, of which `held` are
    the motions of these ports; `loads` are shared among nodes that are free.
    """
    k, m = (tied.T @ matrix @ tied for matrix in matrices)
    if interface == "free":
        return free_interface(k, m, modes + rigid.shape[1])
    check_choice(owner, "interface", interface, ("fixed", "free"))
    if len(held):
        component = craig_bampton(k, m, held, modes)
    else:
        component = free_interface(k, m, modes + rigid.shape[1])
    if not loads.shape[1]:
        return component
    return with_loads(component, k, m, held, rigid, tied.T @ loads)


def _matrix(owner: str, given: Matrix | str | Path) -> Matrix:
    """The matrix, read from its file if it is the name of one."""
    if not isinstance(given, str | Path):
        return given
    import scipy.io  # here, since few ask for it

    try:
        if Path(given).suffix == ".npz":
            return sp.load_npz(given)
        return scipy.io.mmread(given, spmatrix=False)
    except (OSError, ValueError) as error:
        raise SceneError(
            f"{owner}: {given} is no Matrix Market file, and no sparse matrix of SciPy ({error}); "
            "romjax.load_mesh reads those of Abaqus, CalculiX and Nastran."
        ) from error
