"""Proper orthogonal decomposition."""

from typing import Any

import jax.numpy as jnp

from .basis import Basis
from .build import build
from .rank import Rank, choose_rank
from .snapshots import Motion, weigh


def pod(
    motion: Motion,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
) -> Basis:
    """Proper orthogonal modes and values of a motion (chapter equation 39.8).

    The modes are the left singular vectors of the snapshots q − q̄, weighted by mass and time, so
    that the values mean energy-norm amplitude and do not depend on units or sample rate.

    **Arguments:**

    - `motion`: a Trajectory.
    - `rank`: number of modes, or "drop" (the default): where the values fall most steeply, if by
      two decades at least; else every direction above rounding.
    - `tol`: instead of a rank, keep the values above `tol` times the largest.
    - `offset`: q̄ (n,), the first configuration unless given.

    Raises ValueError if the snapshots do not move, are not finite, or do not allow the rank.
    """
    snapshots = weigh(motion, offset)
    vectors, values, _ = jnp.linalg.svd(snapshots.positions, full_matrices=False)
    chosen = choose_rank("pod", values, rank, tol, snapshots.positions.shape[1])
    return build(motion, snapshots, vectors[:, : chosen.rank], values, values, "POD", chosen.reason)
