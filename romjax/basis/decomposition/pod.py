"""Proper orthogonal decomposition."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from ..basis import Basis
from ..build import build
from ..rank import FLOOR, Rank, choose_rank
from ..snapshots import Motion, Recording, weigh
from ..subspace import Method, leading, singular_values

# What the eigenvalue problem of the Gram matrix still sees: the values are roots.
_GRAM_FLOOR = {jnp.dtype("float64"): 1e-7, jnp.dtype("float32"): 1e-3}


def pod(
    motion: Motion | Sequence[Motion],
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
    method: Method = "svd",
) -> Basis:
    """Proper orthogonal modes and values of a motion (chapter equation 39.8).

    The modes are the left singular vectors of the snapshots q − q̄, weighted by mass and time, so
    that the values mean energy-norm amplitude and do not depend on units or sample rate. They
    differentiate as a subspace, exactly, wherever the value that follows the last is smaller.

    **Arguments:**

    - `motion`: a Trajectory, or several of one mechanism.
    - `rank`: number of modes, or "drop" (the default): where the values fall most steeply, if by
      two decades at least; else every direction above the noise.
    - `tol`: instead of a rank, keep the values above `tol` times the largest, and above the noise:
      rounding, and the errors that the tolerances of the simulation allow.
    - `offset`: q̄ (n,), the first configuration unless given.
    - `method`: "svd", or "gram" for the eigenvalue problem of the smaller Gram matrix (equations
      39.9, 39.10): faster for long runs, blind below 1e-7 of the largest value.

    Raises ValueError if the snapshots do not move, are not finite, or do not allow the rank.
    """
    if method not in ("svd", "gram"):
        raise ValueError(f'pod: method={method!r}; it must be "svd" or "gram".')
    recording = Recording.of(motion)
    snapshots = weigh(recording, offset)
    found = singular_values(snapshots.positions, method)
    floor = (_GRAM_FLOOR if method == "gram" else FLOOR)[found.dtype]
    chosen = choose_rank("pod", found, rank, tol, floor, recording.noise.positions)
    vectors, values = leading(snapshots.positions, chosen.rank, method)
    return build(recording, snapshots, vectors, values, values, "POD", chosen)
