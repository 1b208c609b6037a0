"""The record of what happened in a run."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..common.compat import is_traced
from ..common.described import Described


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

    @staticmethod
    def arrays() -> dict[str, Described]:
        """Return the descriptions of its arrays in files, by their names."""
        return {
            "time": Described(("occurrence",), "s", "when it happened"),
            "happened": Described(("occurrence", "event"), "1", "which events did"),
            "impulse": Described(("occurrence", "event"), "N s", "impulses of impacts"),
            "q": Described(("occurrence", "coordinate"), "", "generalized coordinates then"),
            "v_before": Described(("occurrence", "coordinate"), "", "their rates before"),
            "v_after": Described(("occurrence", "coordinate"), "", "their rates after"),
            "lasting": Described((), "", "whether the run ended since bodies stayed in contact"),
        }

    @property
    def is_impact(self) -> Bool[Array | np.ndarray, " most"]:
        """Whether each row is of an impact, which changes velocities; of one run, by NumPy where
        JAX does not trace.
        """
        rows = (self.count, self.v_before, self.v_after)
        xp: Any = jnp if any(is_traced(x) for x in rows) else np
        count, before, after = (xp.asarray(x) for x in rows)
        changes: Array | np.ndarray = xp.any(before != after, axis=1)
        changes &= xp.arange(len(before)) < count
        return changes

    def without_unused(self) -> "Events":
        """The record without unused rows; of one run, where JAX does not trace."""
        # Shapes are those of `max_events` while JAX traces.
        count = int(self.count)
        rows = {name: np.asarray(getattr(self, name)) for name in self.arrays()}
        cut: dict[str, Any] = {name: x[:count] if x.ndim else x for name, x in rows.items()}
        return dataclasses.replace(self, **cut)

    def times(self, event: int = 0) -> np.ndarray:
        """The times [s] at which one of the events happened, by its number in the list that was
        given; of one run, where JAX does not trace.
        """
        times: np.ndarray = np.asarray(self.time)[np.asarray(self.happened)[:, event]]
        return times
