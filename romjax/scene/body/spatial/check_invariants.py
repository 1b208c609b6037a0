"""Checks of inertia invariants in space."""

from typing import Any

import numpy as np

from ....common.compat import is_traced
from ....common.errors import SceneError
from ....linalg import quaternions
from ...fields import check_numbers


def check_invariants(owner: str, inertia: Any, modes: int) -> None:
    """Raise a SceneError that names owner, field, value and remedy; `inertia`: a SpatialInertia."""
    shapes: dict[str, tuple[int, ...]] = {
        "mass": (),
        "moment": (3, 3),
        "modal": (modes, modes),
        "first_moment": (3,),
        "shift": (3, modes),
        "swing": (3, modes),
        "stretch": (3, 3, modes),
        "spread": (3, 3, modes, modes),
        "gyration": (3, modes, modes),
        "foreshortening": (3, modes, modes),
    }
    for field, shape in shapes.items():
        check_numbers(owner, inertia, field, shape=shape, prefix="inertia.")
    matrix = _undeformed(inertia, modes)
    if matrix is None:
        return
    skew = np.max(abs(matrix - matrix.T))
    if skew > 1e-9 * np.max(abs(matrix)):
        raise SceneError(
            f"{owner}: inertia.moment, or modal, is not symmetric: entries differ by {skew:g}."
        )
    least = np.min(np.linalg.eigvalsh(matrix))
    if not least > 0:
        raise SceneError(
            f"{owner}: its mass matrix is not positive definite, with an eigenvalue of "
            f"{least:g}; check the signs of the invariants, and that modes are independent."
        )


def _undeformed(inertia: Any, modes: int) -> np.ndarray | None:
    """The mass matrix of V, ω and q̇_f of the undeformed body; None while JAX traces. By NumPy,
    since this compiles nothing.
    """
    numbers = {name: value for name, value in vars(inertia).items() if value is not None}
    if any(is_traced(value) for value in numbers.values()):
        return None
    get: Any = {name: np.asarray(value) for name, value in numbers.items()}.get
    aside = quaternions.skew(get("first_moment", np.zeros(3)))
    frame = np.block([[get("mass") * np.eye(3), -aside], [aside, get("moment")]])
    none = np.zeros((3, modes))
    beside = np.concatenate([get("shift", none), get("swing", none)])
    return np.block([[frame, beside], [beside.T, get("modal", np.eye(modes))]])
