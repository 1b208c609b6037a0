"""What speaks against the result of a reduced model."""

import enum
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class Flag(enum.IntFlag):
    """What speaks against the motion of a reduced model."""

    NONE = 0
    OUTSIDE_TRAINING = 1
    VIOLATION = 2
    ENERGY = 4


WORDS = {
    Flag.OUTSIDE_TRAINING: "it leaves the box of the snapshots that the reduced model was made of",
    Flag.VIOLATION: "it violates the constraints by more than the snapshots in the basis do",
    Flag.ENERGY: "its energy changes by more than the work of the forces",
}

# By how much of its width a motion may leave the training box on each side. Directions much
# narrower than the widest one are allowed a thousandth of that.
_MARGIN, _NARROW = 0.1, 1e-3
# How many times the training's violation is too much, and what is never too much.
_TIMES, _ROUNDING = 10.0, 1e-7
# The share of the range of kinetic energy that may come from nowhere.
_ENERGY = 0.01


class Training(eqx.Module):
    """What a reduced model was made of.

    - `lower`, `upper` (r,): the box of the snapshots, in its own coordinates.
    - `violation`: largest |C| of the snapshots in the basis.
    - `error`: estimated error of a run, relative in the energy norm; NaN if nobody estimated it.
    """

    lower: Float[Array, " r"]
    upper: Float[Array, " r"]
    violation: Float[Array, ""]
    error: Float[Array, ""]

    @classmethod
    def of(cls, z: Float[Array, "K r"], violation: Float[Array, ""]) -> "Training":
        """From snapshots in reduced coordinates."""
        return cls(jnp.min(z, axis=0), jnp.max(z, axis=0), violation, jnp.full((), jnp.nan))

    def judge(
        self,
        z: Float[Array, "k r"],
        violation: Float[Array, " k"],
        lost: Float[Array, ""] | None,
    ) -> Int[Array, ""]:
        """What speaks against a run, as the number of a `Flag`.

        `lost`: the share of the kinetic energy's range that no force has worked, if known.
        """
        width = self.upper - self.lower
        allowed = _MARGIN * jnp.maximum(width, _NARROW * jnp.max(width))
        left = jnp.maximum(self.lower[None] - z, z - self.upper[None])
        found: Any = jnp.any(left > allowed[None]) * int(Flag.OUTSIDE_TRAINING)
        limit = jnp.maximum(_TIMES * self.violation, _ROUNDING)
        found += jnp.any(violation > limit) * int(Flag.VIOLATION)
        if lost is not None:
            found += (jnp.abs(lost) > _ENERGY) * int(Flag.ENERGY)
        return found
