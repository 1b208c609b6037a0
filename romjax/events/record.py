"""The record of what happened in a run."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .state import Arrival


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
        """Before the first event; rows that stay unused repeat the start, which is finite."""
        rows = jax.tree.map(lambda x: jnp.broadcast_to(x, (most, *jnp.shape(x))), y0)
        zeros = jnp.zeros((most, events), t0.dtype)
        return cls(jnp.zeros((), int), jnp.full(most, t0), zeros > 0, zeros, rows, rows)

    def put(self, keep: Bool[Array, ""], arrival: Arrival) -> "Record":
        """With what happened at the end of a step, if it was kept."""
        happens = keep & arrival.happens
        number = self.number
        fits = happens & (number < len(self.time))

        def put(rows: Array, row: Array) -> Array:
            at = jnp.minimum(number, len(rows) - 1)
            return rows.at[at].set(jnp.where(fits, row, rows[at]))

        new = (arrival.t, arrival.hits, arrival.impulse, arrival.before, arrival.after)
        rows = jax.tree.map(put, tuple(self[1:]), new)
        return Record(number + jnp.where(happens, 1, 0), *rows)


class Events(eqx.Module):
    """What happened in a run, in the order of time; rows from `count` on are unused.

    - `count`: how often something happened. `time` (most,) [s]; infinite in unused rows.
    - `happened` (most, events): which events did, one column for each that was given.
    - `impulse` (most, events): of impacts [N s].
    - `q` (most, n), `v_before`, `v_after` (most, n): the physical state; velocities differ where
      there is an impact.
    - `lasting`: whether the run ended since bodies stayed in contact.
    """

    count: Int[Array, ""]
    time: Float[Array, " most"]
    happened: Bool[Array, "most events"]
    impulse: Float[Array, "most events"]
    q: Float[Array, "most n"]
    v_before: Float[Array, "most n"]
    v_after: Float[Array, "most n"]
    lasting: Bool[Array, ""]

    def times(self, event: int = 0) -> np.ndarray:
        """The times [s] at which one of the events happened, by its number in the list that was
        given; of one run, where JAX does not trace.
        """
        times: np.ndarray = np.asarray(self.time)[np.asarray(self.happened)[:, event]]
        return times
