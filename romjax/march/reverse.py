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

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from .checkpoints import CheckpointFollower
from .follower import AbstractFollower, Step
from .march import DENSE, EVENTS, OUTPUTS, March
from .outputs import Outputs
from .steps import Progress, Trial, chosen
from .transpose import StepStart, Transposed, TransposedSteps

# The least number of checkpoints. Most runs have fewer steps, so that their derivatives compute no
# state a second time.
_CHECKPOINTS = 512


# A key of `seen`.
_CHECKPOINTED = "checkpoints"


class Closed(AbstractFollower):
    """A follower whose `function` has all that it closes over as numbers of its own."""

    follower: AbstractFollower
    function: Callable[[Step, PyTree], PyTree]

    @classmethod
    def of(cls, follower: AbstractFollower, step: Step, seen: PyTree) -> AbstractFollower:
        """The follower itself, if it calls no functions of users."""
        if not follower.calls_users:
            return follower
        return cls(follower, eqx.filter_closure_convert(follower.follow, step, seen))

    def start(self, start: Progress) -> PyTree:
        return self.follower.start(start)

    def follow(self, step: Step, seen: PyTree) -> PyTree:
        return self.function(step, seen)

    def end(self, end: Progress, stopped: Array, seen: PyTree) -> PyTree:
        return self.follower.end(end, stopped, seen)


class Differentiated(NamedTuple):
    """The arguments by which a march is differentiated: numbers of its steps, and its start."""

    trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    output: Callable[[Float[Array, ""], PyTree], PyTree]
    ts: Float[Array, " size"]
    y: PyTree
    solver_state: PyTree


Outcome = tuple[Progress, dict[str, Any]]


def differentiable_run(march: March, start: Progress, most: int) -> Outcome:
    """`March.run` of at most `most` steps, differentiable in reverse mode."""
    slots = _power_of_two(max(min(_CHECKPOINTS, most), math.sqrt(most)))
    longest = _power_of_two(most / slots)
    # The numbers that these functions close over, which may be the user's, become arguments, since
    # they are differentiated too.
    state = start.y, start.solver_state, start.watching, start.t, start.next_t
    seen, tried = march.before(start), eqx.filter_eval_shape(march.trial, *state)
    step = Step(start, start, tried, {})
    trial = eqx.filter_closure_convert(march.trial, *state)
    output = eqx.filter_closure_convert(march.outputs.output, start.t, start.y)
    others = {name: Closed.of(f, step, seen[name]) for name, f in march.others.items()}
    by = Differentiated(trial, output, march.outputs.ts, start.y, start.solver_state)
    # The rest chooses the steps or only follows them: it is not differentiated.
    nothing: Any = None
    rest = march._replace(trial=nothing, outputs=nothing, others=others)
    asked = march.outputs.asked, march.outputs.beside
    choice = rest, start._replace(y=None, solver_state=None), seen, asked
    arrays, static = eqx.partition(choice, eqx.is_array)
    choice = eqx.combine(jax.lax.stop_gradient(arrays), static)
    outcome: Outcome = _run(by, choice, slots, longest)
    return outcome


def _power_of_two(least: int | float) -> int:
    return 1 << max(math.ceil(math.log2(least)), 0)


def _joined(by: Differentiated, choice: Any) -> tuple[March, Progress, dict[str, Any]]:
    march, start, seen, asked = choice
    march = march._replace(trial=by.trial, outputs=Outputs(by.output, by.ts, *asked))
    return march, start._replace(y=by.y, solver_state=by.solver_state), seen


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
    checkpoints = CheckpointFollower(slots)
    march = march._replace(others={**march.others, _CHECKPOINTED: checkpoints})
    end, seen = march.run(start, {**seen, _CHECKPOINTED: checkpoints.start(start)})
    number, record = seen[OUTPUTS].number, seen.get(EVENTS)
    missing = (number < march.outputs.asked) & ~march.steps.is_stopped(end)
    happened = jnp.zeros((), int) if record is None else record.number
    kept = seen.pop(_CHECKPOINTED)
    return (end, seen), (kept, end.accepted, end.t, number, happened, missing)


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
    by_rows = _filled(cotangents[1], choice[2])
    steps = TransposedSteps(*eqx.partition(by[:3], perturbed[:3]), *by_rows)

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
    unknown = missing & _uses_later(by_rows[0], saved) | _counts(cotangents[1], choice[2])
    nan = jnp.where(unknown, jnp.nan, 0.0)
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


def _counts(cotangents: dict[str, Any], seen: dict[str, Any]) -> Array:
    """Whether something depends on what followers have seen that are constants here."""
    others = [cotangents[name] for name in seen if name not in (OUTPUTS, EVENTS, DENSE)]
    leaves = jax.tree.leaves(eqx.filter(others, eqx.is_inexact_array))
    return jnp.any(jnp.array([jnp.any(x != 0) for x in leaves], bool))


_run.def_fwd(_run_with_checkpoints)  # type: ignore[no-untyped-call]
_run.def_bwd(_transpose)  # type: ignore[no-untyped-call]


def _filled(cotangents: dict[str, Any], seen: dict[str, Any]) -> tuple[PyTree, PyTree, PyTree]:
    """Return the cotangents of outputs, events and dense output, zeros where they are missing."""

    def filled(name: str, part: Callable[[Any], Any] = lambda rows: rows) -> PyTree:
        if name not in seen:
            return None
        return jax.tree.map(
            lambda x, bar: jnp.zeros(x.shape, x.dtype) if bar is None else bar,
            part(seen[name]),
            part(cotangents[name]),
        )

    return filled(OUTPUTS, lambda saved: saved.rows), filled(EVENTS), filled(DENSE)


def _starts(march: March, first: Progress, size: Int[Array, ""], longest: int) -> StepStart:
    """Return the starts of `size` accepted steps, the `first` of which is given."""

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
