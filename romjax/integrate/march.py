"""The loop over the steps of a run that nobody differentiates."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Bool, Float, Int, PyTree

# Steps end at the end of the run if they come so near, in units in the last place: dense output of
# a shorter step would be rounding only.
_NEAR_END = 100


class Progress(NamedTuple):
    """How far a run is, between two steps."""

    y: PyTree
    t: Float[Array, ""]
    next_t: Float[Array, ""]
    solver_state: PyTree
    controller_state: PyTree
    meter_state: PyTree
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    saved: Int[Array, ""]
    outputs: PyTree  # one row for each output time


class March(NamedTuple):
    """An integration from `ts[0]` to `ts[-1]`, with `output(t, y)` at the first `asked` times.

    The steps, their acceptance and the outputs are those of `diffrax.diffeqsolve`. What that brings
    beyond them (checkpoints for derivatives, events, dense output, infinite intervals) takes half a
    second to trace and to compile, a fifth of the time to the first result of a small mechanism.
    Numbers of outputs and of steps are traced here, so that others need no other program. Rows of
    outputs that the run does not get to are infinite.

    In a batch, lanes go on until the last one ends. One that has ended changes nothing any more:
    JAX would choose between all rows of old and new outputs at each step instead.
    """

    term: diffrax.AbstractTerm[Any, Any]
    solver: diffrax.AbstractSolver[Any]
    controller: diffrax.AbstractStepSizeController[Any, Any]
    ts: Float[Array, " size"]
    asked: Int[Array, ""]
    dt0: Float[Array, ""]
    max_steps: Int[Array, ""]
    meter: diffrax.AbstractProgressMeter[Any]
    output: Callable[[Float[Array, ""], PyTree], PyTree]

    def run(self, y0: PyTree) -> Progress:
        """The end of the integration from `y0`."""
        march = self
        if getattr(self.solver, "scan_kind", "none") is None:
            # Stages in a loop without checkpoints.
            stages, none = "lax", lambda x: x is None
            solver = eqx.tree_at(lambda s: s.scan_kind, self.solver, stages, is_leaf=none)
            march = self._replace(solver=solver)
        end: Progress = jax.lax.while_loop(
            lambda now: unvmap_any(march.unfinished(now)), march.step, march.start(y0)
        )
        self.meter.close(end.meter_state)
        exhausted = (end.t < self.ts[-1]) & diffrax.is_successful(end.result)
        result = diffrax.RESULTS.where(exhausted, diffrax.RESULTS.max_steps_reached, end.result)
        return end._replace(result=result)

    def start(self, y0: PyTree) -> Progress:
        """Before the first step."""
        t0, zero = self.ts[0], jnp.zeros((), int)
        order: Any = self.solver.error_order(self.term)
        first, controller_state = self.controller.init(
            self.term, t0, self.ts[-1], y0, self.dt0, None, self.solver.func, order
        )
        next_t = jnp.minimum(first, self.ts[-1])
        rows = jax.eval_shape(self.output, t0, y0)
        size = len(self.ts)
        return Progress(
            y=y0,
            t=t0,
            next_t=next_t,
            solver_state=self.solver.init(self.term, t0, next_t, y0, None),
            controller_state=jax.tree.map(jnp.asarray, controller_state),
            meter_state=self.meter.init(),
            result=jax.tree.map(jnp.asarray, diffrax.RESULTS.successful),
            steps=zero,
            accepted=zero,
            saved=zero,
            outputs=jax.tree.map(lambda x: jnp.full((size, *x.shape), jnp.inf, x.dtype), rows),
        )

    def unfinished(self, now: Progress) -> Bool[Array, ""]:
        """Whether another step follows."""
        going = diffrax.is_successful(now.result)
        return (now.t < self.ts[-1]) & going & (now.steps < self.max_steps)

    def step(self, now: Progress) -> Progress:
        """One step, kept or not, and the outputs on its way."""
        t0, t1, going = now.t, now.next_t, self.unfinished(now)
        order: Any = self.solver.error_order(self.term)
        y, error, dense, solver_state, solved = self.solver.step(
            self.term, t0, t1, now.y, None, now.solver_state, made_jump=False
        )
        # An infinite error rejects the step, which NaN would not.
        error = jax.tree.map(lambda x: jnp.where(jnp.isnan(x), jnp.inf, x), error)
        keep, t, next_t, _, controller_state, controlled = self.controller.adapt_step_size(
            t0, t1, now.y, y, None, error, order, now.controller_state
        )
        keep = jnp.asarray(keep) & going
        t = jnp.where(going, jnp.minimum(t, self.ts[-1]), t0)
        next_t = self._until_end(t, jnp.asarray(next_t), keep)
        solved = diffrax.RESULTS.where(keep, solved, diffrax.RESULTS.successful)
        result = diffrax.RESULTS.where(diffrax.is_successful(solved), controlled, solved)
        between = self.solver.interpolation_cls(t0=t0, t1=t1, **dense)
        saved, outputs = self.save(now, keep, between)
        fraction = (t - self.ts[0]) / (self.ts[-1] - self.ts[0])
        return Progress(
            y=_chosen(keep, y, now.y),
            t=t,
            next_t=jnp.where(going, next_t, t1),
            solver_state=_chosen(keep, solver_state, now.solver_state),
            controller_state=_chosen(going, controller_state, now.controller_state),
            meter_state=self.meter.step(now.meter_state, fraction),
            result=diffrax.RESULTS.where(going, result, now.result),
            steps=now.steps + jnp.where(going, 1, 0),
            accepted=now.accepted + jnp.where(keep, 1, 0),
            saved=saved,
            outputs=outputs,
        )

    def save(
        self, now: Progress, keep: Bool[Array, ""], between: diffrax.AbstractLocalInterpolation
    ) -> tuple[Int[Array, ""], PyTree]:
        """The number of outputs after a step, and all outputs."""

        def is_due(save: tuple[Array, PyTree]) -> Array:
            saved, _ = save
            return keep & (saved < self.asked) & (self.ts[saved] <= now.next_t)

        def put(save: tuple[Array, PyTree]) -> tuple[Array, PyTree]:
            (saved, outputs), due = save, is_due(save)
            t = self.ts[saved]

            def changed(rows: Array, row: Array) -> Array:
                row = jnp.where(due, row, rows[saved])
                after: Array = jax.lax.dynamic_update_index_in_dim(rows, row, saved, 0)
                return after

            row = self.output(t, between.evaluate(t))
            return saved + jnp.where(due, 1, 0), jax.tree.map(changed, outputs, row)

        after: tuple[Array, PyTree] = jax.lax.while_loop(
            lambda save: unvmap_any(is_due(save)), put, (now.saved, now.outputs)
        )
        return after

    def _until_end(self, t: Array, next_t: Array, keep: Array) -> Array:
        # What would end beyond the end, or just before it, ends there; after a rejection, half way.
        t1 = self.ts[-1]
        end = t1 - _NEAR_END * jnp.finfo(t1.dtype).eps * jnp.abs(t1)
        return jnp.where(next_t > end, jnp.where(keep, t1, t + 0.5 * (t1 - t)), next_t)


def _chosen(condition: Bool[Array, ""], new: PyTree, old: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
