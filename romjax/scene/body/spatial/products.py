"""The inertia invariants as products of fields of displacements."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ....common.arrays import namespace


def turned(vectors: Any) -> Any:
    """e_a × u for each axis a of vectors u (points, 3, *k), as (points, 3, a, *k)."""
    xp = namespace(vectors)
    x, y, z = (vectors[:, i] for i in range(3))
    none = xp.zeros_like(x)
    columns = ([none, -z, y], [z, none, -x], [-y, x, none])
    return xp.stack([xp.stack(column, axis=1) for column in columns], axis=2)


def products(weigh: Callable[[Any], Any], rigid: Any, shapes: Any, around: Any) -> dict[str, Any]:
    """The invariants by their names in SpatialInertia, as products of fields with a mass matrix.

    By the axes of the body, the field of velocities is V + ω × (X + S q_f) + S q̇_f: a polynomial in
    q_f whose coefficients are the fields here.

    **Arguments:**

    - `weigh`: a mass matrix times fields (rows, k).
    - `rigid` (rows, 6): fields of unit velocities and of unit angular velocities about the origin.
    - `shapes` (rows, modes): S, and `around` (rows, 3, modes): e_a × S for each axis a.
    """
    rows, modes = shapes.shape
    weighted = weigh(rigid)
    turning, bending = weighted[:, 3:], weigh(shapes)
    around = around.reshape(rows, 3 * modes)
    # ∫ρ (e_a × r)·(e_b × u): how the moments of inertia change with the amplitudes.
    linear = (turning.T @ around).reshape(3, 3, modes)
    # The kinetic energy has the sum of both orders of axes, and of both orders of modes.
    square = (around.T @ weigh(around)).reshape(3, modes, 3, modes)
    square = (square.transpose(0, 2, 1, 3) + square.transpose(0, 2, 3, 1)) / 2
    aside = weighted[:, :3].T @ rigid[:, 3:]  # e_i · (e_a × c)
    # Skew but for rounding: its three entries are the first moment.
    aside = (aside - aside.T) / 2
    return {
        "mass": rigid[:, 0] @ weighted[:, 0],
        "moment": rigid[:, 3:].T @ turning,
        "modal": shapes.T @ bending,
        "first_moment": aside[np.array([1, 2, 0]), np.array([2, 0, 1])],
        "shift": weighted[:, :3].T @ shapes,
        "swing": turning.T @ shapes,
        "stretch": linear + linear.transpose(1, 0, 2),
        "spread": square,
        "gyration": (around.T @ bending).reshape(3, modes, modes),
    }
