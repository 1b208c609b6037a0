"""The motion within the steps of a run: dense output."""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .follower import AbstractFollower, Step
from .steps import Progress


class Interpolations(NamedTuple):
    """The motion within each accepted step, with room for some.

    - `number`: of steps. `ends` (rows,): when they end; infinite in unused rows.
    - `between`: what interpolates within each, leading axis rows.
    """

    number: Int[Array, ""]
    ends: Float[Array, " rows"]
    between: diffrax.AbstractLocalInterpolation

    @classmethod
    def empty(cls, rows: int, between: Any, t0: Float[Array, ""]) -> "Interpolations":
        """Return an empty record for interpolations of the shapes of `between`."""
        empty = jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype), between)
        return cls(jnp.zeros((), int), jnp.full(rows, jnp.inf, t0.dtype), empty)

    def put(
        self,
        keep: Bool[Array, ""],
        end: Float[Array, ""],
        between: diffrax.AbstractLocalInterpolation,
    ) -> "Interpolations":
        """Store the interpolation of a step, if it was accepted."""

        def put(rows: Array, row: Array) -> Array:
            # The last row takes what has no room; such a run fails.
            at = jnp.minimum(self.number, len(rows) - 1)
            return rows.at[at].set(jnp.where(keep, row, rows[at]))

        ends, interpolations = jax.tree.map(put, (self.ends, self.between), (end, between))
        return Interpolations(self.number + jnp.where(keep, 1, 0), ends, interpolations)


class InterpolationFollower(AbstractFollower):
    """Saves the interpolations of accepted steps, shaped like `between`, with room for `rows`."""

    rows: int
    between: Any

    def start(self, start: Progress) -> Interpolations:
        return Interpolations.empty(self.rows, self.between, start.t)

    def follow(self, step: Step, seen: Interpolations) -> Interpolations:
        return seen.put(step.kept, step.after.t, step.tried.between)
