"""The derivative of a march in reverse mode: its steps again, from the last to the first.

The lengths of the steps are constants, as diffrax has them: what a step computes is differentiated.
Of the states that steps start from, some are checkpoints, and those between two of them are
computed once more from the first of the two. How many steps lie between, the stride, is not known
before the end: where all checkpoints are in use, it doubles, and each second of them is free again
(Stumm and Walther 2010, doi:10.1137/080742439, need fewer of them, with more code in each step).

A program that differentiates contains the step three times: as it was, once more for states between
two checkpoints, and with its transpose. Nested checkpoints, as those of
`diffrax.RecursiveCheckpointAdjoint`, need more copies of it and compute more of them anew.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from ..events.record import Record
from ..events.state import Watching
from .audit import Audit, Findings
from .checkpoints import Checkpoints
from .dense import Pieces
from .march import March, Saved
from .steps import Progress, Trial, chosen
from .transpose import StepStart, Transposed, TransposedSteps

# At least: shorter runs, which most are, compute no state anew.
_CHECKPOINTS = 512


class Ended(NamedTuple):
    """How a march has ended."""

    outputs: PyTree
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    findings: Findings | None
    imbalance: Float[Array, " size"] | None
    number: Int[Array, ""]  # of outputs that the run got to
    watching: Watching | None
    record: Record | None
    pieces: Pieces | None


def ended(run: tuple[Progress, Saved, Findings | None, Any]) -> Ended:
    """Of what a march returns."""
    end, saved, findings, _ = run
    return Ended(
        outputs=saved.outputs,
        result=end.result,
        steps=end.steps,
        accepted=end.accepted,
        findings=findings,
        imbalance=saved.imbalance,
        number=saved.number,
        watching=end.watching,
        record=saved.record,
        pieces=saved.pieces,
    )


class Differentiated(NamedTuple):
    """What the derivative of a march is taken by: all numbers of its steps, and where it starts."""

    trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    y: PyTree
    solver_state: PyTree


def differentiable_run(march: March, start: Progress, most: int) -> Ended:
    """`March.run` of at most `most` steps, differentiable in reverse mode."""
    slots = _power_of_two(max(min(_CHECKPOINTS, most), math.sqrt(most)))
    longest = _power_of_two(most / slots)
    # As functions with what they close over in reach, which may be the numbers of the user.
    step = start.y, start.solver_state, start.watching, start.t, start.next_t
    trial = eqx.filter_closure_convert(march.trial, *step)
    output = eqx.filter_closure_convert(march.output, start.t, start.y)
    audit = march.audit
    if audit is not None:
        tried = eqx.filter_eval_shape(march.trial, *step)
        findings = eqx.filter_eval_shape(audit.start, start)
        march = march._replace(
            audit=Audit(
                eqx.filter_closure_convert(audit.start, start),
                eqx.filter_closure_convert(audit.follow, start, start, tried, findings),
            )
        )
    by = Differentiated(trial, output, march.ts, start.y, start.solver_state)
    # All else chooses the steps.
    choice = _without(march, "trial", "output", "ts"), _without(start, "y", "solver_state")
    arrays, others = eqx.partition(choice, eqx.is_array)
    choice = eqx.combine(jax.lax.stop_gradient(arrays), others)
    run: Ended = _run(by, choice, slots, longest)
    return run


def _power_of_two(least: int | float) -> int:
    return 1 << max(math.ceil(math.log2(least)), 0)


def _without(whole: Any, *names: str) -> Any:
    return whole._replace(**dict.fromkeys(names))


def _joined(by: Differentiated, choice: tuple[March, Progress]) -> tuple[March, Progress]:
    march, start = choice
    march = march._replace(trial=by.trial, output=by.output, ts=by.ts)
    return march, start._replace(y=by.y, solver_state=by.solver_state)


@eqx.filter_custom_vjp
def _run(by: Differentiated, choice: Any, slots: int, longest: int) -> Ended:
    del slots, longest
    march, start = _joined(by, choice)
    return ended(march.run(start))


def _run_with_checkpoints(
    perturbed: Any, by: Differentiated, choice: Any, slots: int, longest: int
) -> Any:
    del perturbed, longest
    march, start = _joined(by, choice)
    run = march.run(
        start, lambda before, after, seen: seen.put(before, after), Checkpoints.none(start, slots)
    )
    end, saved, _, checkpoints = run
    missing = (saved.number < march.asked) & ~march.steps.is_stopped(end)
    happened = jnp.zeros((), int) if saved.record is None else saved.record.number
    return ended(run), (checkpoints, end.accepted, end.t, saved.number, happened, missing)


def _transpose(
    residuals: Any,
    cotangents: Ended,
    perturbed: Any,
    by: Differentiated,
    choice: Any,
    slots: int,
    longest: int,
) -> Any:
    del slots
    checkpoints, accepted, t, saved, happened, missing = residuals
    march, stride = _joined(by, choice)[0], checkpoints.stride
    # A checkpoint has all of a start; `by` lacks what is not differentiated.
    start = checkpoints.get(jnp.zeros((), int))
    by_saved = (cotangents.outputs, cotangents.record, cotangents.pieces)
    by_saved = _filled(by_saved, march, start)
    steps = TransposedSteps(*eqx.partition(by[:3], perturbed[:3]), *by_saved)

    def segment(carry: tuple[Array, Transposed]) -> tuple[Array, Transposed]:
        index, later = carry
        size = jnp.where(index >= 0, jnp.minimum(stride, accepted - index * stride), 0)
        starts = _starts(march, checkpoints.get(index * stride), size, longest)

        def step(carry: tuple[Array, Transposed]) -> tuple[Array, Transposed]:
            i, later = carry
            at = jax.tree.map(lambda x: x[jnp.maximum(i, 0)], starts)
            return i - 1, steps.transpose(at, index * stride + i, later, i >= 0)

        _, later = jax.lax.while_loop(
            lambda carry: unvmap_any(carry[0] >= 0), step, (size - 1, later)
        )
        return index - 1, later

    state = eqx.filter((by.y, by.solver_state), eqx.is_inexact_array)
    numbers, y, solver_state = jax.tree.map(jnp.zeros_like, (steps.numbers, *state))
    end = Transposed(numbers, y, solver_state, t, jnp.zeros_like(t), saved, happened)
    _, first = jax.lax.while_loop(
        lambda carry: unvmap_any(carry[0] >= 0), segment, ((accepted - 1) // stride, end)
    )
    nan = jnp.where(missing & _uses_later(cotangents.outputs, saved), jnp.nan, 0.0)
    numbers, y, solver_state = jax.tree.map(lambda x: x + nan.astype(x.dtype), first[:3])
    trial, output, ts = numbers
    return Differentiated(trial, output, ts, y, solver_state)


def _uses_later(cotangents: PyTree, number: Int[Array, ""]) -> Array:
    """Whether outputs after the first `number` of them count: where the run did not get there, they
    are no numbers, and neither are their derivatives.
    """

    def counts(x: Array) -> Array:
        late = jnp.arange(len(x)) >= number
        return jnp.any((x != 0) & late.reshape(-1, *[1] * (x.ndim - 1)))

    leaves = jax.tree.leaves(eqx.filter(cotangents, eqx.is_inexact_array))
    return jnp.any(jnp.array([counts(x) for x in leaves], bool))


_run.def_fwd(_run_with_checkpoints)  # type: ignore[no-untyped-call]
_run.def_bwd(_transpose)  # type: ignore[no-untyped-call]


def _filled(cotangents: PyTree, march: March, start: Progress) -> PyTree:
    """With zeros where nothing depends on what was saved."""

    def saved() -> tuple[PyTree, PyTree, PyTree]:
        saved = march.nothing_saved(start)
        return saved.outputs, saved.record, saved.pieces

    return jax.tree.map(
        lambda x, bar: jnp.zeros(x.shape, x.dtype) if bar is None else bar,
        jax.eval_shape(saved),
        cotangents,
    )


def _starts(march: March, first: Progress, size: Int[Array, ""], longest: int) -> StepStart:
    """Where `size` accepted steps start, the `first` of them given."""

    def unfinished(now: Progress) -> Array:
        return (now.accepted - first.accepted < size - 1) & march.steps.unfinished(now)

    def again(carry: tuple[Progress, PyTree]) -> tuple[Progress, PyTree]:
        now, rows = carry
        after = chosen(unfinished(now), march.steps.attempt(now, march.trial)[0], now)
        number = after.accepted - first.accepted
        rows = jax.tree.map(lambda all_, x: all_.at[number].set(x), rows, StepStart(*after[:4]))
        return after, rows

    def row(x: Array) -> Array:
        return jnp.zeros((longest, *x.shape), x.dtype).at[0].set(x)

    _, rows = jax.lax.while_loop(
        lambda carry: unvmap_any(unfinished(carry[0])),
        again,
        (first, jax.tree.map(row, StepStart(*first[:4]))),
    )
    starts: StepStart = rows
    return starts
