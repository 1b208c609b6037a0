"""Flags of runs of systems with local bases."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...compiling.program import program_once
from ...system.base import AbstractSystem, AbstractValidity, Run
from ...system.flags import Flag
from .bases import BodyBases

# Elasticity is linear: of larger deflections the modes miss the same share (of four times as large
# ones measured), as long as nothing else about the motion is new.
_TIMES = 10.0


class LargestDeflections(AbstractValidity):
    """A model's region of validity: bodies bend as in training, frames may go anywhere.

    - `largest` (r,): for each amplitude, the largest deflection of its body, |z| in the modal mass;
      infinite for the coordinates of frames.
    - `error`: estimated error of a run, relative in the energy norm; NaN if nobody estimated it.
    """

    largest: Float[Array, " r"]
    error: Float[Array, ""]

    @classmethod
    def of(cls, bases: BodyBases, q: Float[Array, "K n"]) -> "LargestDeflections":
        """Return the largest deflections in snapshots."""
        return cls(*_largest(bases, q))

    def including(self, run: Run) -> "LargestDeflections":
        largest = jnp.maximum(self.largest, jnp.max(jnp.abs(run.q), axis=0))
        return LargestDeflections(largest, self.error)

    @property
    def of_states(self) -> "LargestDeflections":
        return self

    def flags(self, system: AbstractSystem, run: Run) -> Int[Array, ""]:
        del system
        outside: Array = jnp.any(jnp.abs(run.q) > _TIMES * self.largest[None])
        return outside * int(Flag.OUTSIDE_TRAINING)


@program_once
def _largest(
    bases: BodyBases, q: Float[Array, "K n"]
) -> tuple[Float[Array, " r"], Float[Array, ""]]:
    """The largest deflections of snapshots, and an error that nobody estimated."""
    z = jax.vmap(bases.project)(q)
    largest = jnp.full(z.shape[1], jnp.inf, z.dtype)
    for modes, index in zip(bases.modes, bases.narrow, strict=True):
        own = index.array[:, index.width - modes.shape[2] :]
        size = jnp.max(jnp.linalg.norm(z[:, own], axis=2), axis=0)
        largest = largest.at[own].set(size[:, None])
    return largest, jnp.full((), jnp.nan, z.dtype)
