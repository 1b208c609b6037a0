"""The inertia invariants of a mesh, as products with its mass matrix.

They are exact where positions and displacements turned by a right angle are displacements of the
mesh themselves.

All functions take positions (nodes, d), rows of the matrices (nodes, k) and, by these rows, the
mass matrix and displacements by unit rigid motions and by mass-normalised elastic modes.
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
    """In the plane."""
    radius, turned = np.zeros(mass.shape[0]), np.zeros_like(elastic)
    radius[rows[:, 0]], radius[rows[:, 1]] = positions.T
    turned[rows[:, 0]], turned[rows[:, 1]] = -elastic[rows[:, 1]], elastic[rows[:, 0]]
    total, moment = rigid[:, 0] @ (mass @ rigid[:, 0]), rigid[:, 2] @ (mass @ rigid[:, 2])
    terms = {
        "first_moment": (rigid[:, :2].T @ (mass @ radius), (total * moment) ** 0.5),
        "stretch": ((mass @ radius) @ elastic, moment**0.5),
        "gyration": (elastic.T @ (mass @ turned), 1.0),
    }
    return Inertia(total, moment, **_nonzero(terms))


def spatial_inertia(
    positions: np.ndarray,
    rows: np.ndarray,
    mass: Matrix,
    rigid: np.ndarray,
    elastic: np.ndarray,
) -> SpatialInertia:
    """In space; rotations turn with the axes as displacements do."""
    del positions
    around = np.zeros((len(elastic), 3, elastic.shape[1]))
    for first in range(0, rows.shape[1], 3):
        own = rows[:, first : first + 3]
        around[own] = turned(elastic[own])
    terms = products(lambda fields: mass @ fields, rigid, elastic, around)
    total, moment = terms.pop("mass"), terms.pop("moment")
    del terms["modal"]  # the identity
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


def _nonzero(terms: dict[str, tuple[Any, float]]) -> dict[str, Any]:
    """Those of the terms that are more than rounding of their sizes."""
    return {name: x for name, (x, size) in terms.items() if np.any(abs(x) > ROUNDING * size)}
