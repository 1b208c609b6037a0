"""Whether a motion stays on its branch where constraints lose rank."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...common import precision
from ...common.described import Described
from ...common.plain import plain
from ...linalg.kkt import KKT
from ...system.flags import Flag

# Branches are told apart while |C| is below this share of σ². Of 150 parallelograms at random,
# those that left their branch had 0.026 and more, and 89 of 94 right ones below 0.002. By default
# a run beyond it is repeated, which costs time and no truth.
_AMBIGUOUS = 2e-3
# Pivots of constraints that repeat others, in units of the proximal term.
_REPEATED = 1e3


class Branching(NamedTuple):
    """A measure of how well a motion told its own branch from another one, where it was worst.

    Where constraints become dependent, σ → 0 for the smallest singular value of the scaled C_q, two
    branches of the motion cross. In the normal form of the crossing the dependent combination is
    κ x y, with x along the motion and y across: σ = κ x, and a violation C is the distance
    y = C / σ from the motion. The state is on either branch alike where y is as large as x, which
    is where C reaches σ² / κ. Violations are relative to the size of the mechanism here, so that κ
    is about one.

    - `ambiguity`: largest |C| / σ². `time` [s]: where.
    - `repeated`: how many constraints repeat others in all positions.
    """

    ambiguity: Float[Array, ""]
    time: Float[Array, ""]
    repeated: Int[Array, ""]

    @staticmethod
    def arrays() -> dict[str, Described]:
        """Return the descriptions of its arrays in files, by their names."""
        return {
            "ambiguity": Described(
                (), "1", "largest violation by the square of the singular value"
            ),
            "time": Described((), "s", "when it was largest"),
            "repeated": Described((), "1", "constraints that repeat others"),
        }

    def __repr__(self) -> str:
        return plain(self)

    @classmethod
    def start(cls, t: Float[Array, ""], m: int) -> "Branching":
        """Return the record at the time `t` [s] at which a run with `m` constraints starts.

        The first step, a short one, tells how many repeat others: the same once more for the start
        would make the program longer by a tenth.
        """
        return cls(jnp.zeros_like(t), t, jnp.asarray(m))

    def follow(
        self,
        t: Float[Array, ""],
        kkt: KKT,
        lengths: Float[Array, " rows"],
        violation: Float[Array, " m"],
        q: Float[Array, " n"],
    ) -> "Branching":
        """Return the record with the state at the end of a step added.

        `lengths`: of the rows of C_q, the largest so far. In coordinates of joints rows vanish
        where a loop is stretched, which they do not show once they are of unit length.
        """
        pivots = kkt.pivots()
        # Near a singular position there are more than elsewhere.
        repeated = jnp.minimum(self.repeated, _count_tiny(pivots))
        shares = jnp.where(lengths > 0, kkt.lengths() / jnp.where(lengths > 0, lengths, 1), 1)
        squared = _least_but(pivots, shares, repeated)
        size = jnp.maximum(1.0, jnp.max(jnp.abs(q)))
        ambiguity = jnp.max(jnp.abs(violation)) / (size * squared)
        worse = ambiguity > self.ambiguity
        return Branching(
            jnp.where(worse, ambiguity, self.ambiguity), jnp.where(worse, t, self.time), repeated
        )

    @property
    def flags(self) -> Int[Array, ""]:
        """The reason not to trust the run, if any, as the number of a `Flag`."""
        return (self.ambiguity > _AMBIGUOUS) * int(Flag.BRANCH)

    def describe(self) -> str:
        """The passage in words."""
        return f"at t = {float(self.time):.4g} s"


def _count_tiny(pivots: Float[Array, " rows"]) -> Int[Array, ""]:
    """How many pivots are those of constraints that depend on others."""
    return jnp.sum(pivots < _REPEATED * precision.of(pivots.dtype).proximal)


def _least_but(
    pivots: Float[Array, " rows"], shares: Float[Array, " rows"], count: Int[Array, ""]
) -> Float[Array, ""]:
    """The least pivot, in `shares` of its row's length, but for `count` of the least; without
    sorting, which is a call of a library.
    """

    def without_least(index: Any, pivots: Array) -> Array:
        del index
        return pivots.at[jnp.argmin(pivots)].set(jnp.inf)

    left = jax.lax.fori_loop(0, count, without_least, pivots)
    # No number is infinity times the share of a row that vanishes.
    return jnp.min(jnp.where(jnp.isinf(left), left, left * shares))
