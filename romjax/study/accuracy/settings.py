"""Settings of a study of accuracy, and their checks."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import diffrax

from ...basis.basis import AbstractDecomposition
from ...basis.decomposition.parse import as_decomposition
from ...basis.rank import Rank
from ...common.errors import InputError
from ...integrate.rodas5p import Rodas5P
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from .row import Condition

PRECISIONS = ("f64", "f32")


@dataclasses.dataclass(frozen=True)
class Settings:
    """The arguments of `accuracy`, with objects for names."""

    formulations: Sequence[AbstractFormulation]
    decompositions: Sequence[AbstractDecomposition]
    ranks: Sequence[Rank] | None
    caps: Sequence[float] | None  # [Hz]
    solvers: Sequence[diffrax.AbstractSolver[Any]]
    tolerances: Sequence[float]
    steps: Sequence[float]  # [s]
    conditions: Sequence[Condition]
    repeats: int
    budget: float | None  # [s]

    @classmethod
    def of(
        cls,
        formulations: Sequence[AbstractFormulation | str],
        decompositions: Sequence[AbstractDecomposition | str],
        ranks: Sequence[Rank] | None,
        caps: Sequence[float] | None,
        solvers: Sequence[diffrax.AbstractSolver[Any]] | None,
        tolerances: Sequence[float],
        steps: Sequence[float],
        precisions: Sequence[str],
        lanes: Sequence[int],
        repeats: int,
        budget: float | None,
    ) -> "Settings":
        """Raises InputError or ReductionError for a name or a number that makes no sense."""
        for name in precisions:
            if name not in PRECISIONS:
                raise InputError(f"accuracy: {name!r} is none of {', '.join(PRECISIONS)}.")
        if not len(tolerances) or not all(0 < rtol < 1 for rtol in tolerances) or repeats < 1:
            raise InputError(
                f"accuracy: tolerances={tuple(tolerances)}, repeats={repeats}; give tolerances "
                "between 0 and 1 and one repeat or more."
            )
        if not all(dt > 0 for dt in steps) or not all(count >= 1 for count in lanes):
            raise InputError(
                f"accuracy: steps={tuple(steps)}, lanes={tuple(lanes)}; give steps longer than "
                "0 s, and one lane or more."
            )
        if not all(hertz > 0 for hertz in caps or ()):
            raise InputError(f"accuracy: caps={tuple(caps or ())}; give them in hertz, above 0.")
        return cls(
            [as_formulation(one) for one in formulations],
            [as_decomposition(one) for one in decompositions],
            ranks,
            caps,
            [Rodas5P(), diffrax.Dopri8()] if solvers is None else list(solvers),
            tolerances,
            steps,
            [Condition(*pair) for pair in itertools.product(precisions, lanes)],
            repeats,
            budget,
        )
