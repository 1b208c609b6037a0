"""Settings of a study of accuracy, and their checks."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import diffrax

from ...basis.basis import AbstractDecomposition
from ...basis.rank import Rank
from ...common.errors import InputError
from ...reduction.formulation.base import AbstractFormulation
from .row import Condition

PRECISIONS = ("f64", "f32")


@dataclasses.dataclass(frozen=True)
class Settings:
    """The arguments of `accuracy`, with objects for names.

    Raises InputError for a name or a number that makes no sense.
    """

    formulations: Sequence[AbstractFormulation]
    decompositions: Sequence[AbstractDecomposition]
    ranks: Sequence[Rank] | None
    caps: Sequence[float] | None  # [Hz]
    solvers: Sequence[diffrax.AbstractSolver[Any]]
    tolerances: Sequence[float]
    steps: Sequence[float]  # [s]
    precisions: Sequence[str]
    lanes: Sequence[int]
    repeats: int
    budget: float | None  # [s]

    def __post_init__(self) -> None:
        for name in self.precisions:
            if name not in PRECISIONS:
                raise InputError(f"accuracy: {name!r} is none of {', '.join(PRECISIONS)}.")
        within = all(0 < rtol < 1 for rtol in self.tolerances)
        if not len(self.tolerances) or not within or self.repeats < 1:
            raise InputError(
                f"accuracy: tolerances={tuple(self.tolerances)}, repeats={self.repeats}; give "
                "tolerances between 0 and 1 and one repeat or more."
            )
        if not all(dt > 0 for dt in self.steps) or not all(count >= 1 for count in self.lanes):
            raise InputError(
                f"accuracy: steps={tuple(self.steps)}, lanes={tuple(self.lanes)}; give steps "
                "longer than 0 s, and one lane or more."
            )
        if not all(hertz > 0 for hertz in self.caps or ()):
            raise InputError(
                f"accuracy: caps={tuple(self.caps or ())}; give them in hertz, above 0."
            )

    @property
    def conditions(self) -> list[Condition]:
        """All precisions with all numbers of lanes."""
        return [Condition(*pair) for pair in itertools.product(self.precisions, self.lanes)]
