"""Checks of what the strain shapes of a rod in space are made of."""

from typing import Any

import numpy as np

from ....common.arrays import concrete
from ....common.errors import SceneError
from ...fields import check_finite, check_numbers
from ..rod_checks import check_shapes
from .rod_law import law
from .rod_shapes import SHAPES
from .rod_strains import TURNS

# Shares of the largest entry below which a matrix is symmetric.
_SYMMETRIC = 1e-9


def check_what_shapes_need(rod: Any) -> None:
    """Raise a SceneError unless a rod has what its shapes depend on, which are made first."""
    owner = f"body '{rod.name}'"
    kinds = TURNS + (rod.EA is not None) + 2 * (rod.GA is not None)
    check_shapes(rod, SHAPES, kinds)
    check_numbers(owner, rod, "length", "GJ", "EA", sign="positive")
    check_numbers(owner, rod, "EI", "GA", shape=(2,), sign="positive")
    check_numbers(owner, rod, "rotary", shape=(3,), sign="not negative")
    check_numbers(owner, rod, "retardation", sign="not negative")
    check_numbers(owner, rod, "damping", shape=(rod.modes,), sign="not negative")
    rotary = concrete(rod.rotary)
    if rotary is not None and not rotary[0] > 0:
        raise SceneError(
            f"{owner}: rotary is {rotary.tolist()}; twist moves the inertia about x, ρJ, which "
            "must be positive.",
            field="rotary",
        )
    if rod.GA is not None and rotary is not None and not np.all(rotary > 0):
        raise SceneError(
            f"{owner}: GA is given, but rotary is {rotary.tolist()}; sections that turn against "
            "the axis need a rotary inertia about y and z, or leave GA out.",
            field="rotary",
        )
    if rod.curvature is not None:
        _check_curvature(owner, rod.curvature)
    if rod.coupling is not None:
        check_numbers(owner, rod, "coupling", shape=(kinds, kinds))
        _check_coupling(owner, rod)


def _check_curvature(owner: str, curvature: Any) -> None:
    if curvature.ndim not in (1, 2) or curvature.shape[0] != 3 or curvature.size == 0:
        raise SceneError(
            f"{owner}: curvature has the shape {curvature.shape}; give (3,), twist and curvature "
            "about y and z, or the coefficients (3, k) of their Legendre polynomials.",
            field="curvature",
        )
    check_finite(owner, "curvature", curvature)


def _check_coupling(owner: str, rod: Any) -> None:
    own = concrete(rod.coupling)
    if own is None:
        return
    if np.any(np.diag(own) != 0) or np.max(np.abs(own - own.T)) > _SYMMETRIC * np.max(np.abs(own)):
        raise SceneError(
            f"{owner}: coupling is {own.tolist()}, but it must be symmetric, with zeros on the "
            "diagonal, which EI, GJ, EA and GA are; see Rod.of_stiffness.",
            field="coupling",
        )
    matrix = concrete(law(rod.length, rod.EI, rod.GJ, rod.EA, rod.GA, rod.coupling))
    if matrix is not None and not np.linalg.eigvalsh(matrix)[0] > 0:
        raise SceneError(
            f"{owner}: with this coupling some strain has no positive energy; the matrix of the "
            "section must be positive definite.",
            field="coupling",
        )
