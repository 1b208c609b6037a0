"""Choice of the method and the stabilization of a compiled model."""

from typing import Any, NamedTuple

import diffrax
import numpy as np

from ..common.arrays import as_number
from ..common.compat import is_traced
from ..common.outside import outside_of_traces
from ..integrate.default import default_method
from ..integrate.rodas5p import Rodas5P
from ..system.base import AbstractSystem
from ..system.consistent import check_start_shapes
from ..system.stabilization import Baumgarte
from .beginning import Beginning
from .refuse import refuse


class Choice(NamedTuple):
    """The settings of a run for which nothing else is asked."""

    solver: diffrax.AbstractSolver[Any]
    stabilization: Baumgarte | None
    fastest: Any
    terms: tuple[float, float]  # α and β
    stiff: bool  # whether it is by Rodas5P

    @classmethod
    def of(cls, solver: Any, stabilization: Baumgarte | None, fastest: Any = None) -> "Choice":
        terms = 0.0, 0.0
        if stabilization is not None:
            if is_traced(stabilization.alpha) or is_traced(stabilization.beta):
                refuse(
                    "JAX traces α and β of Baumgarte's terms of a compiled run",
                    "make Baumgarte(alpha, beta) of numbers, outside of the program",
                )
            terms = float(stabilization.alpha), float(stabilization.beta)
        return cls(solver, stabilization, fastest, terms, isinstance(solver, Rodas5P))


class Choices:
    """The choices that a system makes, those of its own start remembered."""

    def __init__(self, system: AbstractSystem, beginning: Beginning) -> None:
        self.system, self.beginning = system, beginning
        self._choices = dict[Any, Choice]()

    def of(
        self,
        ts: Any,
        q0: Any,
        v0: Any,
        dt: float | None,
        solver: diffrax.AbstractSolver[Any] | None,
        stabilization: Any,
    ) -> Choice:
        """The method and the stabilization; those of the own start are remembered."""
        if solver is not None and not isinstance(solver, diffrax.Dopri8 | Rodas5P):
            refuse(
                f"compiled loops are those of diffrax.Dopri8 and romjax.Rodas5P, and not of "
                f"{type(solver).__name__}",
                "take one of them, or leave it to romjax.simulate",
            )
        if not (stabilization in ("default", None) or isinstance(stabilization, Baumgarte)):
            refuse(
                f"compiled loops hold constraints by romjax.Baumgarte, and not by "
                f"{type(stabilization).__name__}",
                "take Baumgarte(alpha, beta) or None, or leave it to romjax.simulate",
            )
        given = stabilization == "default"
        if solver is not None and not given:
            return Choice.of(solver, stabilization)
        if is_traced(ts):
            refuse(
                "JAX traces the output times, which the method and the stabilization depend on",
                "give times of NumPy, or a solver and a stabilization",
            )
        key = (ts[0], ts[-1], len(ts), dt, solver is None or isinstance(solver, Rodas5P), given)
        own = q0 is None and v0 is None and (solver is None)
        if own and given and key in self._choices:
            return self._choices[key]

        def choose() -> Choice:
            start = check_start_shapes(self.system, q0, v0)
            at_start = self.beginning.at(ts, np.concatenate(start), dt)
            step = None if dt is None else as_number(dt, ts.dtype)
            method = solver or default_method(self.system, ts, step, at_start.frequencies).solver
            held = stabilization
            if given:
                terms = at_start.controlled if dt is None else at_start.fixed
                held = Baumgarte(*terms) if self.system.m else None
            return Choice.of(method, held, at_start.frequencies.fastest)

        choice: Choice = outside_of_traces(choose)
        if own and given:
            self._choices[key] = choice
        return choice
