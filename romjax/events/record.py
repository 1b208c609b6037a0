"""The record of what happened in a run."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int


class Events(eqx.Module):
    """The events of a run, in the order of time; rows from `count` on are unused.

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
