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

from .checkpoints import Checkpoints
from .march import March, Saved
from .steps import Progress, Trial, chosen

# At least: shorter runs, which most are, compute no state anew.
_CHECKPOINTS = 512


class Ended(NamedTuple):
    """How a march has ended."""

    outputs: PyTree
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]


def ended(run: tuple[Progress, Saved, Any]) -> Ended:
    """Of what a march returns."""
    end, saved, _ = run
    return Ended(saved.outputs, end.result, end.steps, end.accepted)


class Differentiated(NamedTuple):
    """What the derivative of a march is taken by: all numbers of its steps, and where it starts."""

    trial: Callable[[PyTree, PyTree, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    y: PyTree
    solver_state: PyTree


class Transposed(NamedTuple):
    """What the transposes of all later steps leave for the earlier ones."""

    numbers: Any  # derivatives by trial, output and ts
    y: PyTree  # by the state where the next step starts
    solver_state: PyTree
    t: Float[Array, ""]  # when it starts
    saved: Int[Array, ""]  # outputs before


def differentiable_run(march: March, start: Progress, most: int) -> Ended:
    """`March.run` of at most `most` steps, differentiable in reverse mode."""
    slots = _power_of_two(max(min(_CHECKPOINTS, most), math.sqrt(most)))
    longest = _power_of_two(most / slots)
    # As functions with what they close over in reach, which may be the numbers of the user.
    trial = eqx.filter_closure_convert(
        march.trial, start.y, start.solver_state, start.t, start.next_t
    )
    output = eqx.filter_closure_convert(march.output, start.t, start.y)
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
    end, saved, checkpoints = run
    return ended(run), (checkpoints, end.accepted, end.t, saved.number)


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
    checkpoints, accepted, t, saved = residuals
    (march, start), stride = _joined(by, choice), checkpoints.stride
    steps = _Steps(*eqx.partition(by[:3], perturbed[:3]), _dense(cotangents.outputs, march, start))

    def segment(carry: tuple[Array, Transposed]) -> tuple[Array, Transposed]:
        index, later = carry
        size = jnp.where(index >= 0, jnp.minimum(stride, accepted - index * stride), 0)
        starts = _starts(march, checkpoints.get(index * stride), size, longest)

        def step(carry: tuple[Array, Transposed]) -> tuple[Array, Transposed]:
            i, later = carry
            y, state, t = jax.tree.map(lambda x: x[jnp.maximum(i, 0)], starts)
            return i - 1, steps.transpose(y, state, t, index * stride + i == 0, later, i >= 0)

        _, later = jax.lax.while_loop(
            lambda carry: unvmap_any(carry[0] >= 0), step, (size - 1, later)
        )
        return index - 1, later

    state = eqx.filter((by.y, by.solver_state), eqx.is_inexact_array)
    numbers, y, solver_state = jax.tree.map(jnp.zeros_like, (steps.numbers, *state))
    end = Transposed(numbers, y, solver_state, t, saved)
    _, first = jax.lax.while_loop(
        lambda carry: unvmap_any(carry[0] >= 0), segment, ((accepted - 1) // stride, end)
    )
    trial, output, ts = first.numbers
    return Differentiated(trial, output, ts, first.y, first.solver_state)


_run.def_fwd(_run_with_checkpoints)  # type: ignore[no-untyped-call]
_run.def_bwd(_transpose)  # type: ignore[no-untyped-call]


def _dense(cotangents: PyTree, march: March, start: Progress) -> PyTree:
    """With zeros where nothing depends on an output."""
    outputs = jax.eval_shape(lambda: march.nothing_saved(start.y).outputs)
    return jax.tree.map(
        lambda x, bar: jnp.zeros(x.shape, x.dtype) if bar is None else bar, outputs, cotangents
    )


def _starts(
    march: March, first: Progress, size: Int[Array, ""], longest: int
) -> tuple[PyTree, PyTree, Float[Array, " longest"]]:
    """Where `size` accepted steps start: states and times, the `first` of them given."""

    def unfinished(now: Progress) -> Array:
        return (now.accepted - first.accepted < size - 1) & march.steps.unfinished(now)

    def again(carry: tuple[Progress, PyTree]) -> tuple[Progress, PyTree]:
        now, rows = carry
        after = chosen(unfinished(now), march.steps.attempt(now, march.trial)[0], now)
        number = after.accepted - first.accepted
        rows = jax.tree.map(lambda all_, x: all_.at[number].set(x), rows, after[:3])
        return after, rows

    def row(x: Array) -> Array:
        return jnp.zeros((longest, *x.shape), x.dtype).at[0].set(x)

    _, rows = jax.lax.while_loop(
        lambda carry: unvmap_any(unfinished(carry[0])), again, (first, jax.tree.map(row, first[:3]))
    )
    starts: tuple[PyTree, PyTree, Float[Array, " longest"]] = rows
    return starts


class _Steps(NamedTuple):
    """The steps of a march, as functions that are transposed one by one."""

    numbers: Any  # of trial, output and ts: those by which it is differentiated, else None
    constants: Any  # the others
    cotangents: PyTree  # of all outputs

    def transpose(
        self,
        y: PyTree,
        solver_state: PyTree,
        t0: Array,
        is_first: Array,
        later: Transposed,
        active: Array,
    ) -> Transposed:
        """Before the step that starts at t0 from y, where it is `active`."""
        t1, ts = later.t, eqx.combine(self.numbers, self.constants)[2]

        def advance(numbers: Any, y: PyTree, solver_state: PyTree, t0: Array) -> Any:
            trial, _, _ = eqx.combine(numbers, self.constants)
            return trial(y, solver_state, t0, t1)[:3]

        (_, _, between), pull = eqx.filter_vjp(advance, self.numbers, y, solver_state, t0)

        def is_due(carry: Any) -> Array:
            number, _ = carry
            due: Array = active & (number > 0) & (is_first | (ts[number - 1] > t0))
            return due

        def output(carry: Any) -> Any:
            (number, total), due = carry, is_due(carry)

            def row(numbers: Any, between: Any) -> Any:
                _, output, ts = eqx.combine(numbers, self.constants)
                return output(ts[number - 1], between.evaluate(ts[number - 1]))

            _, pull = eqx.filter_vjp(row, self.numbers, between)
            change = pull(jax.tree.map(lambda x: x[number - 1], self.cotangents))
            return jnp.where(due, number - 1, number), chosen(due, _sum(total, change), total)

        moving = eqx.filter(between, eqx.is_inexact_array)
        zero = jax.tree.map(jnp.zeros_like, (self.numbers, moving))
        saved, (by_outputs, by_between) = jax.lax.while_loop(
            lambda carry: unvmap_any(is_due(carry)), output, (later.saved, zero)
        )
        by_trial, by_y, by_state, by_t = pull((later.y, later.solver_state, by_between))
        numbers = _sum(_sum(later.numbers, by_outputs), by_trial)
        if numbers[2] is not None:
            # The first step starts at the first time; when others do is a constant.
            by_start = numbers[2].at[0].add(jnp.where(is_first, by_t, 0.0))
            numbers = (*numbers[:2], by_start)
        earlier = Transposed(numbers, by_y, by_state, t0, saved)
        result: Transposed = chosen(active, earlier, later)
        return result


def _sum(a: PyTree, b: PyTree) -> PyTree:
    """Of two pytrees, the second of which may lack parts that are zero."""
    return jax.tree.map(lambda x, y: x if y is None else x + y, a, b)
