"""A change of the state after each step: to the constraints, or to coordinates that suit it."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from .term import MotionTerm, unwrap


class SettledSolver(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """Any diffrax solver, each step followed by `settle(system, t, q, v) -> (q, v)`.

    The settled state is not the one at which a first-same-as-last method has evaluated the vector
    field, so the wrapped solver is told of a jump at every step. Dense output is that of the
    wrapped solver.
    """

    solver: diffrax.AbstractSolver  # type: ignore[misc]
    settle: Callable

    @property
    def term_structure(self) -> Any:
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:  # type: ignore[override]
        return self.solver.interpolation_cls

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        return self.solver.term_compatible_contr_kwargs

    @property
    def scan_kind(self) -> Any:
        # diffrax's adjoints set it in what they take for a Runge–Kutta method, wrapped or not.
        return self.solver.scan_kind  # type: ignore[attr-defined]

    def order(self, terms: PyTree) -> int | None:
        return self.solver.order(terms)

    def error_order(self, terms: PyTree) -> Any:
        return self.solver.error_order(terms)

    def init(self, terms: PyTree, t0: Any, t1: Any, y0: PyTree, args: PyTree) -> Any:
        return self.solver.init(terms, t0, t1, y0, args)

    def func(self, terms: PyTree, t0: Any, y0: PyTree, args: PyTree) -> PyTree:
        return self.solver.func(terms, t0, y0, args)

    def step(
        self,
        terms: PyTree,
        t0: Any,
        t1: Any,
        y0: PyTree,
        args: PyTree,
        solver_state: Any,
        made_jump: Any,
    ) -> Any:
        del made_jump
        y1, error, dense, state, result = self.solver.step(
            terms, t0, t1, y0, args, solver_state, made_jump=jnp.array(True)
        )
        term, direction = unwrap(terms)
        assert isinstance(term, MotionTerm)
        time = jnp.asarray(t1 * direction, jax.tree.leaves(y1)[0].dtype)
        return self.settle(term.system, time, *y1), error, dense, state, result
