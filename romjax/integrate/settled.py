"""Projection: each step, and each saved point, returned to the constraints."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..system.consistent import project
from .term import MotionTerm, unwrap


class ProjectedSolver(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """Any diffrax solver, followed by a projection to C = 0 and Ċ = 0 in the mass metric.

    The projected state is not the one at which a first-same-as-last method has evaluated the
    vector field, so the wrapped solver is told of a jump at every step. Dense output is that of
    the wrapped solver: it leaves the constraints by about 1e-6 between steps, so `simulate`
    projects the saved points too.
    """

    solver: diffrax.AbstractSolver  # type: ignore[misc]
    sweeps: int = 2

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
        return project(term.system, time, *y1, self.sweeps), error, dense, state, result
