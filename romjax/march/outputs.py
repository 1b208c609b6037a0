"""Outputs at given times."""

import functools
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Bool, Float, Int, PyTree

from .follower import AbstractFollower, Step
from .steps import Progress


class Saved(NamedTuple):
    """The outputs of a run on its way."""

    number: Int[Array, ""]  # of those that the run got to
    rows: PyTree  # one for each output time
    beside: Float[Array, " size"] | None  # a number of another follower, at the step before each


class Outputs(AbstractFollower):
    """`output(t, y)` at the first `asked` of the times `ts`, and a number `beside` each, of what
    other followers have seen.

    The number of outputs is traced, so that others need no other program. Rows of outputs that the
    run does not get to are NaN, which no minimum of a motion and no bounded function hides.
    """

    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    asked: Int[Array, ""]
    beside: Callable[[Mapping[str, Any]], Float[Array, ""]] | None = eqx.field(static=True)

    def start(self, start: Progress) -> Saved:
        rows, size = jax.eval_shape(self.output, start.t, start.y), len(self.ts)
        rows = jax.tree.map(lambda x: jnp.full((size, *x.shape), jnp.inf, x.dtype), rows)
        beside = None if self.beside is None else jnp.full(size, jnp.inf, self.ts.dtype)
        return Saved(jnp.zeros((), int), rows, beside)

    def follow(self, step: Step, seen: Saved) -> Saved:
        """All outputs up to the end of a step."""
        keep, after = step.kept, step.after

        def is_due(saved: Saved) -> Array:
            more = keep & (saved.number < self.asked)
            return more & (self.ts[saved.number] <= after.t)

        def put(saved: Saved) -> Saved:
            number, due, t = saved.number, is_due(saved), self.ts[saved.number]

            def changed(rows: Array, row: Array) -> Array:
                row = jnp.where(due, row, rows[number])
                after: Array = jax.lax.dynamic_update_index_in_dim(rows, row, number, 0)
                return after

            rows = jax.tree.map(changed, saved.rows, self.output(t, step.tried.between.evaluate(t)))
            beside = saved.beside
            if beside is not None and self.beside is not None:
                beside = changed(beside, self.beside(step.seen))
            return Saved(number + jnp.where(due, 1, 0), rows, beside)

        saved: Saved = jax.lax.while_loop(lambda saved: unvmap_any(is_due(saved)), put, seen)
        return saved

    def end(self, end: Progress, stopped: Bool[Array, ""], seen: Saved) -> Saved:
        """Make the outputs NaN that the run does not get to.

        So are their derivatives, which would be zero if the outputs were constants.
        """
        missing = (jnp.arange(len(self.ts)) >= seen.number) & ~stopped
        sizes = [jnp.sum(x**2) for x in jax.tree.leaves(end.y)]
        # NaN that is made of the state has derivatives that are NaN as well.
        unknown = jnp.nan * (1 + functools.reduce(operator.add, sizes))

        def put(rows: Array) -> Array:
            late = missing.reshape(-1, *[1] * (rows.ndim - 1))
            return jnp.where(late, unknown.astype(rows.dtype), rows)

        rows, beside = jax.tree.map(put, (seen.rows, seen.beside))
        return seen._replace(rows=rows, beside=beside)
