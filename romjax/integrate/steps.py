"""Steps of an integration, kept or not, as `diffrax.diffeqsolve` takes them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

# Steps end at the end of the run if they come so near, in units in the last place: dense output of
# a shorter step would be rounding only.
_NEAR_END = 100


class Progress(NamedTuple):
    """How far a run is, between two steps."""

    y: PyTree
    solver_state: PyTree
    t: Float[Array, ""]
    next_t: Float[Array, ""]
    controller_state: PyTree
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]


class Trial(NamedTuple):
    """What a method computes in a step."""

    y: PyTree
    solver_state: PyTree
    between: diffrax.AbstractLocalInterpolation
    error: PyTree
    result: diffrax.RESULTS


class Steps(NamedTuple):
    """How steps are taken.

    `attempt` computes a step by the function `trial`, which is that of the method unless another
    one takes its part.
    """

    term: diffrax.AbstractTerm[Any, Any]
    solver: diffrax.AbstractSolver[Any]
    controller: diffrax.AbstractStepSizeController[Any, Any]
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    dt0: Float[Array, ""]
    max_steps: Int[Array, ""]

    def start(self, y0: PyTree) -> Progress:
        """Before the first step."""
        t0, zero = self.t0, jnp.zeros((), int)
        order: Any = self.solver.error_order(self.term)
        first, controller_state = self.controller.init(
            self.term, t0, self.t1, y0, self.dt0, None, self.solver.func, order
        )
        next_t = jnp.minimum(first, self.t1)
        return Progress(
            y=y0,
            solver_state=self.solver.init(self.term, t0, next_t, y0, None),
            t=t0,
            next_t=next_t,
            controller_state=jax.tree.map(jnp.asarray, controller_state),
            result=jax.tree.map(jnp.asarray, diffrax.RESULTS.successful),
            steps=zero,
            accepted=zero,
        )

    def unfinished(self, now: Progress) -> Bool[Array, ""]:
        """Whether another step follows."""
        going = diffrax.is_successful(now.result)
        return (now.t < self.t1) & going & (now.steps < self.max_steps)

    def trial(self, y: PyTree, solver_state: PyTree, t0: Array, t1: Array) -> Trial:
        """A step of the method from t0 to t1."""
        y1, error, dense, solver_state, result = self.solver.step(
            self.term, t0, t1, y, None, solver_state, made_jump=False
        )
        between = self.solver.interpolation_cls(t0=t0, t1=t1, **dense)
        return Trial(y1, solver_state, between, error, result)

    def attempt(
        self, now: Progress, trial: Callable[[PyTree, PyTree, Array, Array], Trial]
    ) -> tuple[Progress, diffrax.AbstractLocalInterpolation]:
        """One step, kept or not, and the motion in it."""
        t0, t1, going = now.t, now.next_t, self.unfinished(now)
        order: Any = self.solver.error_order(self.term)
        y, solver_state, between, error, solved = trial(now.y, now.solver_state, t0, t1)
        # An infinite error rejects the step, which NaN would not.
        error = jax.tree.map(lambda x: jnp.where(jnp.isnan(x), jnp.inf, x), error)
        keep, t, next_t, _, controller_state, controlled = self.controller.adapt_step_size(
            t0, t1, now.y, y, None, error, order, now.controller_state
        )
        keep = jnp.asarray(keep) & going
        t = jnp.where(going, jnp.minimum(t, self.t1), t0)
        next_t = self._until_end(t, jnp.asarray(next_t), keep)
        solved = diffrax.RESULTS.where(keep, solved, diffrax.RESULTS.successful)
        result = diffrax.RESULTS.where(diffrax.is_successful(solved), controlled, solved)
        after = Progress(
            y=chosen(keep, y, now.y),
            solver_state=chosen(keep, solver_state, now.solver_state),
            t=t,
            next_t=jnp.where(going, next_t, t1),
            controller_state=chosen(going, controller_state, now.controller_state),
            result=diffrax.RESULTS.where(going, result, now.result),
            steps=now.steps + jnp.where(going, 1, 0),
            accepted=now.accepted + jnp.where(keep, 1, 0),
        )
        return after, between

    def without_transpose(self) -> "Steps":
        """The same for runs that nobody differentiates: stages in a loop without checkpoints."""
        if getattr(self.solver, "scan_kind", "none") is not None:
            return self
        stages, none = "lax", lambda x: x is None
        solver = eqx.tree_at(lambda s: s.scan_kind, self.solver, stages, is_leaf=none)
        return self._replace(solver=solver)

    def _until_end(self, t: Array, next_t: Array, keep: Array) -> Array:
        # What would end beyond the end, or just before it, ends there; after a rejection, half way.
        t1 = self.t1
        end = t1 - _NEAR_END * jnp.finfo(t1.dtype).eps * jnp.abs(t1)
        return jnp.where(next_t > end, jnp.where(keep, t1, t + 0.5 * (t1 - t)), next_t)


def chosen(condition: Bool[Array, ""], new: PyTree, old: PyTree) -> PyTree:
    """One of two pytrees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
