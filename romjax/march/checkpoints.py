"""States that a run remembers on its way, evenly, without knowing how long it will be."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .follower import AbstractFollower, Step
from .steps import Progress


class Checkpoint(NamedTuple):
    """All that the steps after it depend on, and what followers had seen, by their names."""

    progress: Progress
    seen: dict[str, Any]


class Checkpoints(NamedTuple):
    """Checkpoints before accepted steps whose numbers are multiples of a stride.

    In use are the slots whose steps are such multiples. When all are, the stride doubles.
    """

    step: Int[Array, " slots"]  # which; −1 in a slot that was never used
    stride: Int[Array, ""]
    rows: Checkpoint  # leading axis slots

    @classmethod
    def none(cls, start: Checkpoint, slots: int) -> "Checkpoints":
        """No checkpoints, and room for some."""
        rows = jax.tree.map(lambda x: jnp.zeros((slots, *jnp.shape(x)), x.dtype), start)
        return cls(jnp.full(slots, -1), jnp.ones((), int), rows)

    def put(self, before: Checkpoint, accepted: Int[Array, ""]) -> "Checkpoints":
        """Store what was `before` an accepted step if the stride divides the step's number.

        `accepted`: how many accepted steps there are after it.
        """
        number = before.progress.accepted
        # With the stride doubled, every second checkpoint is free again.
        full = ~jnp.any(self._free(self.stride))
        stride = jnp.where(full, 2 * self.stride, self.stride)
        # Rejected steps come back with the same number, and store nothing a second time.
        due = (accepted > number) & (number % stride == 0)
        slot = jnp.argmax(self._free(stride))

        def put(rows: Array, row: Array) -> Array:
            return rows.at[slot].set(jnp.where(due, row, rows[slot]))

        return Checkpoints(put(self.step, number), stride, jax.tree.map(put, self.rows, before))

    def get(self, step: Int[Array, ""]) -> Checkpoint:
        """The checkpoint before an accepted step; any, where it is not remembered."""
        slot = jnp.argmax(self.step == step)
        row: Checkpoint = jax.tree.map(lambda x: x[slot], self.rows)
        return row

    def _free(self, stride: Int[Array, ""]) -> Array:
        return (self.step < 0) | (self.step % stride != 0)


class CheckpointFollower(AbstractFollower):
    """Checkpoints before steps of a run, with room for some: `slots`.

    `transposed`: what the followers have seen at the start that reverse mode passes through.
    """

    slots: int
    transposed: dict[str, Any]

    def start(self, start: Progress) -> Checkpoints:
        return Checkpoints.none(Checkpoint(start, self.transposed), self.slots)

    def follow(self, step: Step, seen: Checkpoints) -> Checkpoints:
        known = {name: step.seen[name] for name in self.transposed}
        return seen.put(Checkpoint(step.before, known), step.after.accepted)
