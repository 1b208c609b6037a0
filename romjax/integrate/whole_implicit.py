"""Methods for sums of two terms, one of which they take explicitly and one implicitly."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..common import compat


class Still(diffrax.AbstractTerm[Any, Any]):
    """The equation y' = 0 of a state that does not change."""

    def vf(self, t: Any, y: Any, args: Any) -> Any:
        return jax.tree.map(jnp.zeros_like, y)

    def contr(self, t0: Any, t1: Any, **kwargs: Any) -> Any:
        return t1 - t0

    def prod(self, vf: Any, control: Any) -> Any:
        return vf


class WholeImplicit(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """A method for a `MultiTerm` of an explicit and an implicit term, such as `diffrax.KenCarp4`.

    It takes the whole equation of motion implicitly: what is stiff in it, in redundant coordinates,
    is no term of its own (M⁻¹ depends on the configuration, and the joints couple all of it).
    """

    solver: diffrax.AbstractSolver[Any]  # type: ignore[misc]

    @property
    def term_structure(self) -> Any:
        return diffrax.AbstractTerm

    @property
    def interpolation_cls(self) -> Any:  # type: ignore[override]
        return self.solver.interpolation_cls

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        return {}

    @property
    def scan_kind(self) -> Any:
        return compat.scan_kind(self.solver)

    def order(self, terms: PyTree) -> int | None:
        return self.solver.order(_both(terms))

    def error_order(self, terms: PyTree) -> Any:
        return self.solver.error_order(_both(terms))

    def init(self, terms: PyTree, t0: Any, t1: Any, y0: PyTree, args: PyTree) -> Any:
        return self.solver.init(_both(terms), t0, t1, y0, args)

    def func(self, terms: PyTree, t0: Any, y0: PyTree, args: PyTree) -> PyTree:
        return terms.vf(t0, y0, args)

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
        return self.solver.step(_both(terms), t0, t1, y0, args, solver_state, made_jump)


def takes_two_terms(solver: diffrax.AbstractSolver[Any]) -> bool:
    """Whether a method is made for such a sum."""
    return isinstance(solver, diffrax.AbstractImplicitSolver) and (
        getattr(solver.term_structure, "__origin__", None) is diffrax.MultiTerm
    )


def _both(term: diffrax.AbstractTerm[Any, Any]) -> diffrax.MultiTerm[Any]:
    return diffrax.MultiTerm(Still(), term)
