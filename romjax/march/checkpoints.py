"""States that a run remembers on its way, evenly, without knowing how long it will be."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .follower import AbstractFollower, Step
from .steps import Progress


class Checkpoints(NamedTuple):
    """States before accepted steps whose numbers are multiples of a stride.

    In use are the slots whose steps are such multiples. When all are, the stride doubles.
    """

    step: Int[Array, " slots"]  # which; −1 in a slot that was never used
    stride: Int[Array, ""]
    progress: Progress  # leading axis slots

    @classmethod
    def none(cls, start: Progress, slots: int) -> "Checkpoints":
        """No checkpoints, and room for some."""
        rows = jax.tree.map(lambda x: jnp.zeros((slots, *jnp.shape(x)), x.dtype), start)
        return cls(jnp.full(slots, -1), jnp.ones((), int), rows)

    def put(self, before: Progress, after: Progress) -> "Checkpoints":
        """Store the state `before` an accepted step if the stride divides the step's number."""
        full = ~jnp.any(self._free(self.stride))
        stride = jnp.where(full, 2 * self.stride, self.stride)
        due = (after.accepted > before.accepted) & (before.accepted % stride == 0)
        slot = jnp.argmax(self._free(stride))

        def put(rows: Array, row: Array) -> Array:
            return rows.at[slot].set(jnp.where(due, row, rows[slot]))

        progress = jax.tree.map(put, self.progress, before)
        return Checkpoints(put(self.step, before.accepted), stride, progress)

    def get(self, step: Int[Array, ""]) -> Progress:
        """The state before an accepted step; any, where it is not remembered."""
        slot = jnp.argmax(self.step == step)
        progress: Progress = jax.tree.map(lambda x: x[slot], self.progress)
        return progress

    def _free(self, stride: Int[Array, ""]) -> Array:
        return (self.step < 0) | (self.step % stride != 0)


class CheckpointFollower(AbstractFollower):
    """States before steps of a run, with room for some: `slots`."""

    slots: int

    def start(self, start: Progress) -> Checkpoints:
        return Checkpoints.none(start, self.slots)

    def follow(self, step: Step, seen: Checkpoints) -> Checkpoints:
        return seen.put(step.before, step.after)
