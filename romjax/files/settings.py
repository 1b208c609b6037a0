"""The `[run]` table of a scene file."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Literal

import diffrax

from ..common.errors import InputError
from ..integrate.rodas5p import Rodas5P

# A run has so many outputs at most: more do not fit into memory.
_OUTPUTS = 1e6

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
    """The settings with which the command line runs the scene of a file.

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

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> "Settings":
        """Make the settings from the table of a file, which may say 2 for 2.0."""
        floats = {field.name for field in dataclasses.fields(cls) if field.type is float}
        values: dict[str, Any] = {key: float(x) if key in floats else x for key, x in table.items()}
        return cls(**values)

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, int | float) and not 0 < value < math.inf:
                raise InputError(f"{field.name} is {value}, but it must be positive.")
        if self.end * self.rate > _OUTPUTS:
            raise InputError(
                f"rate is {self.rate:g} Hz, {self.end * self.rate:.1e} outputs in {self.end:g} s; "
                f"ask for {_OUTPUTS:.0e} at most."
            )
