"""Modes of a free uniform beam in space: bending in two planes, torsion and extension."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre

from ..free_modes import derivative, free_modes, quadrature


class Counts(NamedTuple):
    """How many modes of each kind there are; the modes of a beam are in this order."""

    along_y: int
    along_z: int
    torsion: int
    extension: int


def motion(counts: Counts, xi: Any, xp: Any = jnp) -> tuple[Any, Any]:
    """Displacements along x, y, z of the axis at ξ, and rotations about them of the section there,
    both (3, modes): of unit length and unit normalisation, so rotations of bending are dw/dξ.
    """
    series = [free_modes(2, n).series for n in counts[:2]] + [
        free_modes(1, n).series for n in counts[2:]
    ]
    along_y, along_z, twist, stretch = (derivative(x, xi) for x in series)
    slope_y, slope_z = (derivative(x, xi, 1) for x in series[:2])
    none = [xp.zeros(n) for n in counts]
    moved = (
        (none[0], none[1], none[2], stretch),
        (along_y, none[1], none[2], none[3]),
        (none[0], along_z, none[2], none[3]),
    )
    # By the right hand, a slope of y turns sections about z, one of z about −y.
    turned = (
        (none[0], none[1], twist, none[3]),
        (none[0], -slope_z, none[2], none[3]),
        (slope_y, none[1], none[2], none[3]),
    )
    rows = [xp.concatenate(row) for row in (*moved, *turned)]
    return xp.stack(rows[:3]), xp.stack(rows[3:])


def foreshortening(counts: Counts) -> np.ndarray:
    """∫θᵀθ dξ of the rotations θ of bending, from the middle to ξ: its series in Legendre
    polynomials of 2ξ − 1, (degrees, modes, modes).
    """
    nodes, weights = quadrature(max(counts))
    degree = 2 * max(counts)
    # Squares of polynomials have twice their degree, and their series ends there.
    projector = legendre.legvander(2 * nodes - 1, degree) * (2 * np.arange(degree + 1) + 1)
    tilts = [motion(counts, xi, np)[1][1:] for xi in nodes]
    squares = np.array([tilt.T @ tilt for tilt in tilts])
    return legendre.legint(np.einsum("i,id,ikl->dkl", weights, projector, squares), scl=0.5)
