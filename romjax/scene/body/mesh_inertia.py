"""The inertia invariants of a mesh, as products with its mass matrix.

They are exact where positions and displacements turned by a right angle are displacements of the
mesh themselves. Of a body that is reduced already the modal coordinates have no places: its mass,
moment and first moment are exact, and stretch, gyration and spread are those of its nodes.

All functions take positions (nodes, d), rows of the matrices (nodes, k), −1 where a node has none,
and, by these rows, the mass matrix and displacements by unit rigid motions and by mass-normalised
elastic modes.
"""

from typing import Any

import numpy as np

from .component_modes import Matrix
from .inertia import Inertia
from .spatial.inertia import SpatialInertia
from .spatial.products import products, turned

# Inertia terms smaller than this share of their natural size are rounding; the program of the
# dynamics has no code for them.
ROUNDING = 1e-10


def planar_inertia(
    positions: np.ndarray,
    rows: np.ndarray,
    mass: Matrix,
    rigid: np.ndarray,
    elastic: np.ndarray,
) -> Inertia:
    """Return the inertia of a mesh in the plane, with its elastic modes."""
    radius, around = np.zeros(mass.shape[0]), turned_fields(2, rows, elastic)[:, 0]
    radius[rows[:, 0]], radius[rows[:, 1]] = positions.T
    total, moment = rigid[:, 0] @ (mass @ rigid[:, 0]), rigid[:, 2] @ (mass @ rigid[:, 2])
    # Each invariant with its natural size: modes have modal mass one, so that one √(kg m²) is that
    # of their products with the moment of inertia.
    terms = {
        "first_moment": (rigid[:, :2].T @ (mass @ radius), (total * moment) ** 0.5),
        "stretch": ((mass @ radius) @ elastic, moment**0.5),
        "gyration": (elastic.T @ (mass @ around), 1.0),
    }
    return Inertia(total, moment, **_nonzero(terms))


def spatial_inertia(
    positions: np.ndarray,
    rows: np.ndarray,
    mass: Matrix,
    rigid: np.ndarray,
    elastic: np.ndarray,
) -> SpatialInertia:
    """Return the inertia of a mesh in space, with its elastic modes."""
    del positions
    around = turned_fields(3, rows, elastic)
    terms = products(lambda fields: mass @ fields, rigid, elastic, around)
    total, moment = terms.pop("mass"), terms.pop("moment")
    del terms["modal"]  # the identity
    # The radius of gyration stands for the size of the body.
    length = (np.trace(moment) / total) ** 0.5
    sizes = {
        "first_moment": total * length,
        "shift": total**0.5,
        "swing": total**0.5 * length,
        "stretch": total**0.5 * length,
        "spread": 1.0,
        "gyration": 1.0,
    }
    sized = {name: (x, sizes[name]) for name, x in terms.items()}
    return SpatialInertia(total, (moment + moment.T) / 2, **_nonzero(sized))


def turned_fields(dimension: int, rows: np.ndarray, elastic: np.ndarray) -> np.ndarray:
    """Displacements turned by a right angle about each axis, (n, 1 or 3, modes); in space rotations
    turn with the axes as displacements do.
    """
    if dimension == 2:
        around = np.zeros((len(elastic), 1, elastic.shape[1]))
        x, y = rows[:, 0], rows[:, 1]
        around[x, 0], around[y, 0] = -elastic[y], elastic[x]
        return around
    around = np.zeros((len(elastic), 3, elastic.shape[1]))
    for first in range(0, rows.shape[1], 3):
        own = rows[rows[:, first] >= 0, first : first + 3]
        around[own] = turned(elastic[own])
    return around


def slow_enough(
    dimension: int, rows: np.ndarray, mass: Matrix, frequencies: np.ndarray, elastic: np.ndarray
) -> float:
    """Return the angular velocity [rad/s] up to which frequencies err by a hundredth at most.

    The error is that of modal coordinates, which have no places to turn.

    Turned about all axes a mode that is mass-normalised has the norms 1 in the plane, 2 in space;
    what is missing is the error of what rotation does to ω², as a share of Ω².
    """
    around = turned_fields(dimension, rows, elastic)
    fields = around.reshape(len(elastic), -1)
    norms = np.sum(fields * (mass @ fields), axis=0).reshape(around.shape[1:]).sum(axis=0)
    missing = abs(1 - norms / (dimension - 1))
    # An error of Ω² times `missing` in ω² is a hundredth of ω where it is two hundredths of ω².
    # Where nothing is missing any angular velocity will do.
    return float(np.min(frequencies * np.sqrt(2e-2 / np.maximum(missing, 1e-12))))


def _nonzero(terms: dict[str, tuple[Any, float]]) -> dict[str, Any]:
    """Return the terms that are larger than rounding of their sizes."""
    return {name: x for name, (x, size) in terms.items() if np.any(abs(x) > ROUNDING * size)}
