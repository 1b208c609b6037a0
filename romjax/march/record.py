"""The record of events in the order of time."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .cuts import Arrival
from .follower import AbstractFollower, Step
from .steps import Progress


class Record(NamedTuple):
    """Events in the order of time, in the state that is integrated; room for `most` of them."""

    number: Int[Array, ""]
    time: Float[Array, " most"]
    hits: Bool[Array, "most events"]
    impulse: Float[Array, "most events"]
    before: Any  # states, leading axis most
    after: Any

    @classmethod
    def empty(cls, most: int, events: int, t0: Float[Array, ""], y0: Any) -> "Record":
        """Return an empty record; rows that stay unused repeat the start, which is finite."""
        rows = jax.tree.map(lambda x: jnp.broadcast_to(x, (most, *jnp.shape(x))), y0)
        zeros = jnp.zeros((most, events), t0.dtype)
        return cls(jnp.zeros((), int), jnp.full(most, t0), zeros > 0, zeros, rows, rows)

    def put(self, keep: Bool[Array, ""], arrival: Arrival) -> "Record":
        """Store what happened at the end of a step, if it was kept."""
        happens = keep & arrival.happens
        number = self.number
        # Beyond the room, events are counted still, by which the run knows that it has failed.
        fits = happens & (number < len(self.time))

        def put(rows: Array, row: Array) -> Array:
            at = jnp.minimum(number, len(rows) - 1)
            return rows.at[at].set(jnp.where(fits, row, rows[at]))

        new = (arrival.t, arrival.hits, arrival.impulse, arrival.before, arrival.after)
        rows = jax.tree.map(put, tuple(self[1:]), new)
        return Record(number + jnp.where(happens, 1, 0), *rows)


class RecordFollower(AbstractFollower):
    """Events at the ends of steps, with room for `most` of them."""

    most: int

    def start(self, start: Progress) -> Record:
        assert start.watching is not None
        return Record.empty(self.most, len(start.watching.side), start.t, start.y)

    def follow(self, step: Step, seen: Record) -> Record:
        assert step.tried.arrival is not None
        return seen.put(step.kept, step.tried.arrival)
