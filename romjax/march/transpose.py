"""The transposes of single steps of a march, from the last to the first."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Float, Int, PyTree

from .cuts import Watching
from .steps import chosen


class StepStart(NamedTuple):
    """The state at which a step starts, and what followers had `seen` by then, by their names."""

    y: PyTree
    solver_state: PyTree
    watching: Watching | None
    t: Float[Array, ""]
    seen: dict[str, PyTree]


class Transposed(NamedTuple):
    """The cotangents that the transposes of all later steps leave for the earlier ones."""

    numbers: Any  # derivatives by trial, output, ts and followers
    y: PyTree  # by the state where the next step starts
    solver_state: PyTree
    seen: dict[str, PyTree]  # by what followers had seen there
    t: Float[Array, ""]  # when it starts
    by_t: Float[Array, ""]  # derivative by that
    saved: Int[Array, ""]  # outputs before
    happened: Int[Array, ""]  # events before


class TransposedSteps(NamedTuple):
    """The steps of a march, as functions that are transposed one by one."""

    # Derivatives are taken by the numbers of trial, output, ts and followers that are not None.
    numbers: Any
    constants: Any  # the others
    cotangents: PyTree  # of all outputs
    by_events: Any  # cotangents of the record of events, a `Record`; None where there is none
    by_interpolations: Any  # cotangents of dense output, `Interpolations`; None without it

    def transpose(
        self, start: StepStart, number: Array, later: Transposed, active: Array
    ) -> Transposed:
        """Return the cotangents before the step of this `number`, where it is `active`."""
        is_first = number == 0
        t0, t1, ts = start.t, later.t, eqx.combine(self.numbers, self.constants)[2]

        (_, _, between, _, _), pull, happens = eqx.filter_vjp(
            partial(self.advance, start.watching, t1),
            self.numbers,
            start.y,
            start.solver_state,
            t0,
            start.seen,
            has_aux=True,
        )

        def is_due(carry: Any) -> Array:
            number, _ = carry
            due: Array = active & (number > 0) & (is_first | (ts[number - 1] > t0))
            return due

        def output(carry: Any) -> Any:
            (number, total), due = carry, is_due(carry)

            def row(numbers: Any, between: Any) -> Any:
                _, output, ts, _ = eqx.combine(numbers, self.constants)
                return output(ts[number - 1], between.evaluate(ts[number - 1]))

            _, pull = eqx.filter_vjp(row, self.numbers, between)
            change = pull(jax.tree.map(lambda x: x[number - 1], self.cotangents))
            return jnp.where(due, number - 1, number), chosen(due, add(total, change), total)

        moving = eqx.filter(between, eqx.is_inexact_array)
        zero = jax.tree.map(jnp.zeros_like, (self.numbers, moving))
        saved, (by_outputs, by_between) = jax.lax.while_loop(
            lambda carry: unvmap_any(is_due(carry)), output, (later.saved, zero)
        )
        if self.by_interpolations is not None:
            own = eqx.filter(
                self.by_interpolations.between, jax.tree.map(lambda _: True, by_between)
            )
            by_between = add(by_between, jax.tree.map(lambda x: x[number], own))
        happened, by_event = self.at_event(happens, later)
        by_trial, by_y, by_state, by_t, by_seen = pull(
            (later.y, later.solver_state, by_between, by_event, later.seen)
        )
        numbers = add(add(later.numbers, by_outputs), by_trial)
        if numbers[2] is not None:
            # The first step starts at a number of the user, the first time. Later starts are chosen
            # by the step size control, which is not differentiated.
            by_start = numbers[2].at[0].add(jnp.where(is_first, by_t, 0.0))
            numbers = (*numbers[:2], by_start, numbers[3])
        earlier = Transposed(numbers, by_y, by_state, by_seen, t0, by_t, saved, happened)
        result: Transposed = chosen(active, earlier, later)
        return result

    def advance(
        self,
        watching: Watching | None,
        t1: Array,
        numbers: Any,
        y: PyTree,
        solver_state: PyTree,
        t0: Array,
        seen: dict[str, PyTree],
    ) -> tuple[Any, Array | None]:
        """Return what a step to t1 gives that has derivatives, and whether an event ends it."""
        trial, _, _, followers = eqx.combine(numbers, self.constants)
        tried = trial(y, solver_state, watching, t0, t1)
        arrival, end, event, happens = tried.arrival, t1, None, None
        if arrival is not None:
            happens = arrival.happens
            # The time of an event has derivatives; that of other steps is a constant.
            end = jnp.where(happens, arrival.t, t1)
            event = (arrival.t, arrival.impulse, arrival.before, arrival.after)
        new = {
            name: each.function(t0, y, end, tried.y, tried.between, seen[name])
            for name, each in followers.items()
        }
        new = eqx.filter(new, eqx.is_inexact_array)
        return (tried.y, tried.solver_state, tried.between, event, new), happens

    def at_event(self, happens: Array | None, later: Transposed) -> tuple[Array, Any]:
        """Return the number of events before a step, and the cotangents of the event at its end."""
        if happens is None:
            return later.happened, None
        number = later.happened - jnp.where(happens, 1, 0)
        row = jnp.clip(number, 0, len(self.by_events.time) - 1)
        fits = happens & (number < len(self.by_events.time))
        time, impulse, before, after = jax.tree.map(
            lambda x: jnp.where(fits, x[row], 0.0),
            (self.by_events.time, *self.by_events[3:]),
        )
        # The next step starts at the time of the event.
        return number, (time + jnp.where(happens, later.by_t, 0.0), impulse, before, after)


def add(a: PyTree, b: PyTree) -> PyTree:
    """Return the sum of two pytrees; parts that are zero may be missing in the second."""
    return jax.tree.map(lambda x, y: x if y is None else x + y, a, b)
