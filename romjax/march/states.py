"""States at the ends of steps, thinned while there are too many."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .follower import AbstractFollower, Step
from .steps import Progress


class States(NamedTuple):
    """States at the ends of every so many accepted steps, the start among them.

    - `number`: how many states there are; `skipped`: how many steps there were since the last one,
      and `stride`: how many there are from one to the next.
    - `t` (rows,) [s], `y`: times and states, leading axis rows.
    """

    number: Int[Array, ""]
    skipped: Int[Array, ""]
    stride: Int[Array, ""]
    t: Float[Array, " rows"]
    y: Any

    def put(self, keep: Bool[Array, ""], t: Float[Array, ""], y: Any) -> "States":
        """Count a step, if it was accepted, and store where it ends, if it is its turn."""
        skipped = self.skipped + jnp.where(keep, 1, 0)
        # Nothing is stored between two strides; the row is written with what it holds.
        takes = skipped == self.stride
        rows = len(self.t)

        def put(old: Array, row: Array) -> Array:
            at = jnp.minimum(self.number, rows - 1)
            return old.at[at].set(jnp.where(takes, row, old[at]))

        times, states = jax.tree.map(put, (self.t, self.y), (t, y))
        number = self.number + jnp.where(takes, 1, 0)
        stored = States(number, jnp.where(takes, 0, skipped), self.stride, times, states)
        thinned: States = jax.lax.cond(number == rows, States._thinned, lambda x: x, stored)
        return thinned

    def _thinned(self) -> "States":
        """Every second state, of an odd number of them: the first and the last one stay."""

        def every_second(rows: Array) -> Array:
            # The second half keeps its old rows, which the next states overwrite: shapes stay.
            half = rows[::2]
            return jnp.concatenate([half, rows[len(half) :]])

        t, y = jax.tree.map(every_second, (self.t, self.y))
        return States((self.number + 1) // 2, self.skipped, 2 * self.stride, t, y)


class StateFollower(AbstractFollower):
    """Saves at most `rows` states, an odd number, as dense as the steps are.

    A motion is sampled so where it is fast, however few outputs there are.
    """

    rows: int

    def start(self, start: Progress) -> States:
        rows = jax.tree.map(lambda x: jnp.broadcast_to(x, (self.rows, *jnp.shape(x))), start.y)
        one = jnp.ones((), int)
        return States(one, 0 * one, one, jnp.full(self.rows, start.t), rows)

    def follow(self, step: Step, seen: States) -> States:
        return seen.put(step.kept, step.after.t, step.after.y)

    def end(self, end: Progress, stopped: Bool[Array, ""], seen: States) -> States:
        """Return the record with the state at the end in all rows that are left."""
        del stopped
        # The state at the end belongs to the motion, whatever the stride.
        used = jnp.arange(self.rows) < seen.number

        def filled(rows: Array, last: Array) -> Array:
            return jnp.where(used.reshape(-1, *[1] * last.ndim), rows, last)

        t, y = jax.tree.map(filled, (seen.t, seen.y), (end.t, end.y))
        return seen._replace(t=t, y=y)
