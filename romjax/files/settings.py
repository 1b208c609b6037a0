"""What the `[run]` table of a scene file says."""

import dataclasses
import math
from typing import Any, Literal

import diffrax

from ..errors import InputError
from ..integrate.rodas5p import Rodas5P

Method = Literal["Rodas5P", "Dopri8", "Dopri5", "Tsit5", "Kvaerno5"]


def solver_of(name: Method | None) -> diffrax.AbstractSolver[Any] | None:
    """The method of a name; None, which is chosen by stiffness, for none."""
    if name is None:
        return None
    solver: diffrax.AbstractSolver[Any] = (
        Rodas5P() if name == "Rodas5P" else getattr(diffrax, name)()
    )
    return solver


@dataclasses.dataclass(frozen=True)
class Settings:
    """How `romjax run` simulates a scene.

    - `end`: simulated time [s]. `rate`: outputs per second [Hz].
    - `rtol`: tolerance of all runs.
    - `solver`: the method; chosen by stiffness unless given.
    - `pod_rank`, `sod_rank`: numbers of modes; the drop point unless given.

    Raises InputError for a number that is not positive.
    """

    end: float = 1.0
    rate: float = 100.0
    rtol: float = 1e-8
    solver: Method | None = None
    pod_rank: int | None = None
    sod_rank: int | None = None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, int | float) and not 0 < value < math.inf:
                raise InputError(f"{field.name} is {value}, but it must be positive.")
