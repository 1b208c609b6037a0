"""Whether a mechanism can move at all."""

import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import concrete
from ..common.errors import InputError
from ..compiling.program import program_once
from .base import AbstractSystem
from .dynamics import jacobian
from .structure import without_names


def check_mobility(
    owner: str,
    system: AbstractSystem,
    remedy: str = "",
    error: type[InputError] = InputError,
) -> None:
    """Raise an error if more constraints than freedoms leave no motion at the start.

    Lengths of quaternions are no freedoms. Repeated constraints do not count: a mechanism may have
    them, and the solution of its equations of motion stays unique.
    """
    structure = system.structure
    freedoms = system.n - len(structure.quaternions) - len(structure.states)
    if system.m <= freedoms:
        return
    rows = concrete(_at_start(without_names(system)))
    if rows is not None and np.linalg.matrix_rank(rows) == freedoms:
        words = f"{system.m} constraints on {system.n} coordinates leave no motion. {remedy}"
        raise error(f"{owner}: {words}".rstrip())


@program_once
def _at_start(system: AbstractSystem) -> Float[Array, "m n"]:
    """The constraint Jacobian at the start."""
    return jacobian(system, 0.0, system.q0)
