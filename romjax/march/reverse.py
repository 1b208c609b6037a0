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
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from .checkpoints import Checkpoint, CheckpointFollower
from .closed import Closed, ClosedWatch, Closure, Transposable
from .cotangents import differentiable, is_used, of_followers, of_rows, uses_later
from .follower import Step
from .march import DENSE, EVENTS, OUTPUTS, March
from .outputs import Outputs
from .steps import Progress, Trial, chosen
from .transpose import StepStart, Transposed, TransposedSteps

# The least number of checkpoints. Most runs have fewer steps, so that their derivatives compute no
# state a second time.
_CHECKPOINTS = 512


# A key of `seen`.
_CHECKPOINTED = "checkpoints"

_REFUSED = (
    "Reverse mode does not pass through what {} has seen: take its derivatives in forward mode, "
    "with adjoint=diffrax.ForwardMode(), or inside of romjax.forward_mode()."
)


class Differentiated(NamedTuple):
    """The arguments by which a march is differentiated: numbers of its steps, and its start.

    - `followers`: those that reverse mode passes through, and `seen`: what they see at the start.
    """

    trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    followers: dict[str, Transposable]
    y: PyTree
    solver_state: PyTree
    seen: dict[str, PyTree]


Outcome = tuple[Progress, dict[str, Any]]


def differentiable_run(march: March, start: Progress, most: int) -> Outcome:
    """`March.run` of at most `most` steps, differentiable in reverse mode."""
    # There are at least as many as the square root of the largest number of steps, so that the
    # states between two checkpoints need no more room than these.
    slots = _power_of_two(max(min(_CHECKPOINTS, most), math.sqrt(most)))
    longest = _power_of_two(most / slots)
    # The numbers that these functions close over, which may be the user's, become arguments, since
    # they are differentiated too.
    state = start.y, start.solver_state, start.watching, start.t, start.next_t
    seen, tried = march.before(start), eqx.filter_eval_shape(march.trial, *state)
    step = Step(start, start, tried, {})
    trial = Closure.of(march.trial, *state)
    output = Closure.of(march.outputs.output, start.t, start.y)
    others: dict[str, Any] = {}
    transposed: dict[str, Transposable] = {}
    for name, follower in march.others.items():
        if follower.is_transposed:
            transposed[name] = Transposable.of(follower, step, seen[name])
        else:
            others[name] = Closed.of(follower, step, seen[name])
    by = Differentiated(
        trial=trial,
        output=output,
        ts=march.outputs.ts,
        followers=transposed,
        y=start.y,
        solver_state=start.solver_state,
        seen={name: seen.pop(name) for name in transposed},
    )
    # What chooses the steps, or only follows them, is not differentiated.
    nothing: Any = None
    steps = march.steps._replace(watch=ClosedWatch.of(march.steps.watch, step))
    undifferentiated = March(steps, nothing, nothing, others)
    asked = march.outputs.asked, march.outputs.beside
    choice = undifferentiated, start._replace(y=None, solver_state=None), seen, asked
    arrays, static = eqx.partition(choice, eqx.is_array)
    choice = eqx.combine(jax.lax.stop_gradient(arrays), static)
    outcome: Outcome = _run(by, choice, slots, longest)
    return outcome


def _power_of_two(least: int | float) -> int:
    return 1 << max(math.ceil(math.log2(least)), 0)


def _joined(by: Differentiated, choice: Any) -> tuple[March, Progress, dict[str, Any]]:
    march, start, seen, asked = choice
    march = march._replace(
        trial=by.trial,
        outputs=Outputs(by.output, by.ts, *asked),
        others={**march.others, **by.followers},
    )
    return march, start._replace(y=by.y, solver_state=by.solver_state), {**seen, **by.seen}


@eqx.filter_custom_vjp
def _run(by: Differentiated, choice: Any, slots: int, longest: int) -> Outcome:
    del slots, longest
    march, start, seen = _joined(by, choice)
    return march.run(start, seen)


def _run_with_checkpoints(
    perturbed: Any, by: Differentiated, choice: Any, slots: int, longest: int
) -> Any:
    del perturbed, longest
    march, start, seen = _joined(by, choice)
    checkpoints = CheckpointFollower(slots, by.seen)
    march = march._replace(others={**march.others, _CHECKPOINTED: checkpoints})
    end, seen = march.run(start, {**seen, _CHECKPOINTED: checkpoints.start(start)})
    number, record = seen[OUTPUTS].number, seen.get(EVENTS)
    missing = (number < march.outputs.asked) & ~march.steps.is_held(end)
    happened = jnp.zeros((), int) if record is None else record.number
    states = seen.pop(_CHECKPOINTED)
    return (end, seen), (states, end.accepted, end.t, number, happened, missing)


def _transpose(
    residuals: Any,
    cotangents: Outcome,
    perturbed: Any,
    by: Differentiated,
    choice: Any,
    slots: int,
    longest: int,
) -> Any:
    del slots
    checkpoints, accepted, t, saved, happened, missing = residuals
    march, stride = _joined(by, choice)[0], checkpoints.stride
    by_rows = of_rows(cotangents[1], choice[2])
    by_seen = of_followers(cotangents[1], by.seen)
    # Followers that nothing depends on are no part of the transposed program.
    used, is_perturbed = (
        (*each[:3], {name: each.followers[name] for name in by_seen}) for each in (by, perturbed)
    )
    steps = TransposedSteps(*eqx.partition(used, is_perturbed), *by_rows)

    def segment(carry: tuple[Array, Transposed]) -> tuple[Array, Transposed]:
        index, later = carry
        # The last segment has what is left of the accepted steps.
        size = jnp.where(index >= 0, jnp.minimum(stride, accepted - index * stride), 0)
        starts = _starts(march, by_seen, checkpoints.get(index * stride), size, longest)

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
    end = Transposed(numbers, y, solver_state, by_seen, t, jnp.zeros_like(t), saved, happened)
    _, first = jax.lax.while_loop(
        lambda carry: unvmap_any(carry[0] >= 0), segment, ((accepted - 1) // stride, end)
    )
    # Outputs that the run did not get to have no derivatives.
    nan = jnp.where(missing & uses_later(by_rows[0], saved), jnp.nan, 0.0)
    for name in choice[2].keys() - {OUTPUTS, EVENTS, DENSE}:
        if differentiable(cotangents[1][name]):
            nan = eqx.error_if(nan, is_used(cotangents[1][name]), _REFUSED.format(name))
    numbers, y, solver_state, at_start = jax.tree.map(lambda x: x + nan.astype(x.dtype), first[:4])
    trial, output, ts, followers = numbers
    none = jax.tree.map(lambda _: None, (by.followers, by.seen))
    return Differentiated(
        trial, output, ts, none[0] | followers, y, solver_state, none[1] | at_start
    )


_run.def_fwd(_run_with_checkpoints)  # type: ignore[no-untyped-call]
_run.def_bwd(_transpose)  # type: ignore[no-untyped-call]


def _starts(
    march: March,
    names: Collection[str],
    checkpoint: Checkpoint,
    size: Int[Array, ""],
    longest: int,
) -> StepStart:
    """Return the starts of `size` accepted steps, the first of which is at a checkpoint, with what
    the followers of these `names` have seen before each.
    """
    first = checkpoint.progress
    known = {name: checkpoint.seen[name] for name in names}

    def unfinished(now: Progress) -> Array:
        return (now.accepted - first.accepted < size - 1) & march.steps.unfinished(now)

    def row_of(now: Progress, seen: dict[str, PyTree]) -> StepStart:
        return StepStart(now.y, now.solver_state, now.watching, now.t, seen)

    def again(carry: tuple[Progress, Any, PyTree]) -> tuple[Progress, Any, PyTree]:
        now, seen, rows = carry
        after, tried = march.steps.attempt(now, march.trial)
        # In a batch the loop goes on until the longest lane has ended; the others stay as they are.
        after = chosen(unfinished(now), after, now)
        step = Step(now, after, tried, seen)
        seen = {name: march.others[name].follow(step, seen[name]) for name in names}
        # Rejected steps write the row of their start once more.
        number = after.accepted - first.accepted
        row = row_of(after, seen)
        return after, seen, jax.tree.map(lambda all_, x: all_.at[number].set(x), rows, row)

    def room(x: Array) -> Array:
        return jnp.zeros((longest, *x.shape), x.dtype).at[0].set(x)

    _, _, rows = jax.lax.while_loop(
        lambda carry: unvmap_any(unfinished(carry[0])),
        again,
        (first, known, jax.tree.map(room, row_of(first, known))),
    )
    starts: StepStart = rows
    return starts
