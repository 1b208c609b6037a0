"""Rows of cut joints that repeat others wherever the joints hold: how many, and which to leave out.

A hinge that closes a loop as Bricard's asks for five things of which four imply the fifth. Off the
configurations in which it holds all five are independent, by as much as it is apart, so that the
fifth multiplier and the accelerations would be quotients of two violations.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...common import precision
from ...common.arrays import concrete
from ...compiling.program import program_once

# Singular values of rows of unit length below this share of the largest are zero.
_ZERO = 1e-7
# Other configurations are looked for so far from the start, by so many directions and steps.
_AWAY, _DIRECTIONS, _STEPS = 0.1, 2, 30
# Largest |C| there, as a share of that after projection: no singular value that it makes counts.
_HELD = 1e-2
# Among rows that are equally independent but for rounding, earlier ones are preferred, by this
# share at most.
_PREFERRED = 0.1


def independent_rows(rows: Float[Array, "m r"], rank: int) -> Bool[Array, " m"]:
    """Return the `rank` rows that span most, by Gram–Schmidt with pivots; of equals the first."""
    lengths = jnp.sqrt(jnp.sum(rows**2, axis=1, keepdims=True))
    left = jax.lax.stop_gradient(rows / jnp.where(lengths > 0, lengths, 1))
    favour = np.linspace(1, 1 - _PREFERRED, len(rows)).astype(rows.dtype)
    chosen = jnp.zeros(len(rows), bool)
    for _ in range(rank):
        sizes = jnp.sum(left**2, axis=1)
        best = jnp.argmax(jnp.where(chosen, -1, favour * sizes))
        chosen = chosen | (np.arange(len(rows)) == best)
        along = left[best] / jnp.sqrt(jnp.maximum(sizes[best], jnp.finfo(rows.dtype).tiny))
        left = left - jnp.sum(left * along[None], axis=1, keepdims=True) * along[None]
    return chosen


def rank_of_rows(system: Any) -> int | None:
    """How many of the rows of the cut joints of a JointSystem are independent along its motions;
    None where all are, or nothing is known, as while JAX traces.

    The start may be a singular position, which has fewer than others: the most at the start and at
    configurations near it counts, to which Levenberg–Marquardt steps lead from some distance along
    its freedoms.
    """
    start = concrete(system.q0)
    if not system.m or start is None or start.dtype != np.float64:
        return None
    rank, freedoms = _rank(np.asarray(_rows(system, start)[1]))
    if rank == system.m:
        return None
    # A fixed seed lets the same mechanism have the same rank each time.
    lot = np.random.default_rng(0)
    ranks = [rank]
    for _ in range(_DIRECTIONS if len(freedoms) else 0):
        away = lot.normal(size=len(freedoms)) @ freedoms
        q = start + _AWAY * away / np.max(np.abs(away))
        for _ in range(_STEPS):
            residual, slopes = map(np.asarray, _rows(system, q))
            if np.max(np.abs(residual)) <= _HELD * precision.of(q.dtype).projected:
                break
            # Levenberg–Marquardt with the square of the residual as its damping, which vanishes
            # with it, so that the last steps are those of Gauss and Newton.
            left, values, across = np.linalg.svd(slopes, full_matrices=False)
            q = q - (left.T @ residual * values / (values**2 + residual @ residual)) @ across
        else:
            return None
        ranks.append(_rank(slopes)[0])
    return max(ranks) if max(ranks) < system.m else None


def _rank(rows: Float[np.ndarray, "m r"]) -> tuple[int, Float[np.ndarray, "freedoms r"]]:
    """The rank of rows, and directions along which none of them changes."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    _, values, across = np.linalg.svd(rows / np.where(lengths > 0, lengths, 1))
    rank = int(np.sum(values > _ZERO * np.max(values, initial=_ZERO)))
    return rank, across[rank:]


@program_once
def _rows(
    system: Any, q: Float[Array | np.ndarray, " r"]
) -> tuple[Float[Array, " m"], Float[Array, "m r"]]:
    """C and C_z."""
    state = system.state(system.time, jnp.asarray(q), jnp.zeros_like(q))
    return system.constraint(system.time, state.z), state.every_row()
