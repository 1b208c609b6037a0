"""The loop over the steps of a run, with outputs on the way."""

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from ..events.record import Record
from .audit import Audit, Findings
from .dense import Pieces
from .steps import Progress, Steps, Trial

Seen = TypeVar("Seen")


class Saved(NamedTuple):
    """The outputs of a run on its way."""

    number: Int[Array, ""]
    outputs: PyTree  # one row for each output time
    imbalance: Float[Array, " size"] | None  # of energy, at the end of the step before [J]
    record: Record | None  # of events, where they are watched
    pieces: Pieces | None  # of dense output, where it is asked for


class March(NamedTuple):
    """An integration from `ts[0]` to `ts[-1]`, with `output(t, y)` at the first `asked` times.

    The steps, their acceptance and the outputs are those of `diffrax.diffeqsolve`. What that brings
    beyond them (infinite intervals, say) takes half a second to trace and to compile, a fifth of
    the time to the first result of a small mechanism, and its events change no state.
    Numbers of outputs and of steps are traced here, so that others need no other program. Rows of
    outputs that the run does not get to are infinite.

    In a batch, lanes go on until the last one ends. One that has ended changes nothing any more:
    JAX would choose between all rows of old and new outputs at each step instead.
    """

    steps: Steps
    trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    asked: Int[Array, ""]
    meter: diffrax.AbstractProgressMeter[Any]
    audit: Audit | None
    events: int  # that there is room for
    dense: int  # steps whose dense output there is room for

    def run(
        self,
        start: Progress,
        observe: Callable[[Progress, Progress, Seen], Seen] = lambda before, after, seen: seen,
        seen: Seen = None,  # type: ignore[assignment]
    ) -> tuple[Progress, Saved, Findings | None, Seen]:
        """The end of the integration, the outputs, the findings of the audit, and what an observer
        of the steps has `seen`: `observe(before, after, seen)` follows each, kept or not.
        """

        def step(carry: Any) -> Any:
            before, saved, findings, seen, meter_state = carry
            after, tried = self.steps.attempt(before, self.trial)
            if self.audit is not None:
                findings = self.audit.follow(before, after, tried, findings)
            saved = self.save(before, after, tried, findings, saved)
            fraction = (after.t - self.ts[0]) / (self.ts[-1] - self.ts[0])
            meter_state = self.meter.step(meter_state, fraction)
            return after, saved, findings, observe(before, after, seen), meter_state

        nothing = self.nothing_saved(start)
        findings = None if self.audit is None else self.audit.start(start)
        end, saved, findings, seen, meter_state = jax.lax.while_loop(
            lambda carry: unvmap_any(self.steps.unfinished(carry[0])),
            step,
            (start, nothing, findings, seen, self.meter.init()),
        )
        self.meter.close(meter_state)
        ended = (end.t >= self.ts[-1]) | self.steps.is_stopped(end)
        exhausted = ~ended & diffrax.is_successful(end.result)
        result = diffrax.RESULTS.where(exhausted, diffrax.RESULTS.max_steps_reached, end.result)
        saved = saved._replace(outputs=self.without_later(end, saved))
        return end._replace(result=result), saved, findings, seen

    def nothing_saved(self, start: Progress) -> Saved:
        """Before the first output."""
        rows, size = jax.eval_shape(self.output, start.t, start.y), len(self.ts)
        outputs = jax.tree.map(lambda x: jnp.full((size, *x.shape), jnp.inf, x.dtype), rows)
        imbalance = None if self.audit is None else jnp.full(size, jnp.inf, self.ts.dtype)
        record = None
        if start.watching is not None:
            record = Record.empty(self.events, len(start.watching.side), start.t, start.y)
        pieces = None
        if self.dense:
            step = start.y, start.solver_state, start.watching, start.t, start.next_t
            between = eqx.filter_eval_shape(self.trial, *step).between
            pieces = Pieces.empty(self.dense, between, start.t)
        return Saved(jnp.zeros((), int), outputs, imbalance, record, pieces)

    def without_later(self, end: Progress, saved: Saved) -> PyTree:
        """The outputs, those that the run does not get to infinite, and so in their derivatives,
        which would be zero if they were constants.
        """
        missing = (jnp.arange(len(self.ts)) >= saved.number) & ~self.steps.is_stopped(end)
        sizes = [jnp.sum(x**2) for x in jax.tree.leaves(end.y)]
        infinite = jnp.inf * (1 + functools.reduce(operator.add, sizes))

        def put(rows: Array) -> Array:
            late = missing.reshape(-1, *[1] * (rows.ndim - 1))
            return jnp.where(late, infinite.astype(rows.dtype), rows)

        return jax.tree.map(put, saved.outputs)

    def save(
        self,
        before: Progress,
        after: Progress,
        tried: Trial,
        findings: Findings | None,
        saved: Saved,
    ) -> Saved:
        """All outputs after a step, and its events."""
        keep, between = after.accepted > before.accepted, tried.between
        if saved.record is not None and tried.arrival is not None:
            saved = saved._replace(record=saved.record.put(keep, tried.arrival))
        if saved.pieces is not None:
            saved = saved._replace(pieces=saved.pieces.put(keep, after.t, between))

        def is_due(saved: Saved) -> Array:
            more = keep & (saved.number < self.asked)
            return more & (self.ts[saved.number] <= after.t)

        def put(saved: Saved) -> Saved:
            number, due, t = saved.number, is_due(saved), self.ts[saved.number]

            def changed(rows: Array, row: Array) -> Array:
                row = jnp.where(due, row, rows[number])
                after: Array = jax.lax.dynamic_update_index_in_dim(rows, row, number, 0)
                return after

            outputs = jax.tree.map(changed, saved.outputs, self.output(t, between.evaluate(t)))
            imbalance = saved.imbalance
            if imbalance is not None and findings is not None:
                imbalance = changed(imbalance, findings.balance.imbalance)
            more = number + jnp.where(due, 1, 0)
            return saved._replace(number=more, outputs=outputs, imbalance=imbalance)

        all_saved: Saved = jax.lax.while_loop(lambda saved: unvmap_any(is_due(saved)), put, saved)
        return all_saved
