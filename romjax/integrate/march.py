"""The loop over the steps of a run, with outputs on the way."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import diffrax
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from .steps import Progress, Steps, Trial

Seen = TypeVar("Seen")


class Saved(NamedTuple):
    """The outputs of a run on its way."""

    number: Int[Array, ""]
    outputs: PyTree  # one row for each output time


class March(NamedTuple):
    """An integration from `ts[0]` to `ts[-1]`, with `output(t, y)` at the first `asked` times.

    The steps, their acceptance and the outputs are those of `diffrax.diffeqsolve`. What that brings
    beyond them (events, dense output, infinite intervals) takes half a second to trace and to
    compile, a fifth of the time to the first result of a small mechanism. Numbers of outputs and of
    steps are traced here, so that others need no other program. Rows of outputs that the run does
    not get to are infinite.

    In a batch, lanes go on until the last one ends. One that has ended changes nothing any more:
    JAX would choose between all rows of old and new outputs at each step instead.
    """

    steps: Steps
    trial: Callable[[PyTree, PyTree, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    asked: Int[Array, ""]
    meter: diffrax.AbstractProgressMeter[Any]

    def run(
        self,
        start: Progress,
        observe: Callable[[Progress, Progress, Seen], Seen] = lambda before, after, seen: seen,
        seen: Seen = None,  # type: ignore[assignment]
    ) -> tuple[Progress, Saved, Seen]:
        """The end of the integration, the outputs, and what an observer of the steps has `seen`:
        `observe(before, after, seen)` follows each, kept or not.
        """

        def step(carry: Any) -> Any:
            before, saved, seen, meter_state = carry
            after, between = self.steps.attempt(before, self.trial)
            saved = self.save(before, after, between, saved)
            fraction = (after.t - self.ts[0]) / (self.ts[-1] - self.ts[0])
            meter_state = self.meter.step(meter_state, fraction)
            return after, saved, observe(before, after, seen), meter_state

        end, saved, seen, meter_state = jax.lax.while_loop(
            lambda carry: unvmap_any(self.steps.unfinished(carry[0])),
            step,
            (start, self.nothing_saved(start.y), seen, self.meter.init()),
        )
        self.meter.close(meter_state)
        exhausted = (end.t < self.ts[-1]) & diffrax.is_successful(end.result)
        result = diffrax.RESULTS.where(exhausted, diffrax.RESULTS.max_steps_reached, end.result)
        return end._replace(result=result), saved, seen

    def nothing_saved(self, y0: PyTree) -> Saved:
        """Before the first output."""
        rows, size = jax.eval_shape(self.output, self.ts[0], y0), len(self.ts)
        outputs = jax.tree.map(lambda x: jnp.full((size, *x.shape), jnp.inf, x.dtype), rows)
        return Saved(jnp.zeros((), int), outputs)

    def save(
        self,
        before: Progress,
        after: Progress,
        between: diffrax.AbstractLocalInterpolation,
        saved: Saved,
    ) -> Saved:
        """All outputs after a step."""
        keep = after.accepted > before.accepted

        def is_due(saved: Saved) -> Array:
            more = keep & (saved.number < self.asked)
            return more & (self.ts[saved.number] <= before.next_t)

        def put(saved: Saved) -> Saved:
            (number, outputs), due, t = saved, is_due(saved), self.ts[saved.number]

            def changed(rows: Array, row: Array) -> Array:
                row = jnp.where(due, row, rows[number])
                after: Array = jax.lax.dynamic_update_index_in_dim(rows, row, number, 0)
                return after

            outputs = jax.tree.map(changed, outputs, self.output(t, between.evaluate(t)))
            return Saved(number + jnp.where(due, 1, 0), outputs)

        all_saved: Saved = jax.lax.while_loop(lambda saved: unvmap_any(is_due(saved)), put, saved)
        return all_saved
