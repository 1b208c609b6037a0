"""Smooth orthogonal decomposition, with a rank that does not flip."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .basis import Basis
from .build import build
from .rank import Rank, choose_rank
from .snapshots import Motion, Snapshots, weigh


def sod(
    motion: Motion,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
) -> Basis:
    """Smooth orthogonal modes and values of a motion (chapter equation 39.12).

    The chapter's generalised eigenvalue problem is singular wherever a coordinate rests, and its
    rank flips with the sample rate. Here no correlation matrix is formed: the weighted velocities
    are compressed to their own r directions, V = U Σ Wᵀ; the positions, seen in these as
    Y = Σ⁻¹ Uᵀ X = P D Nᵀ, give the values λ = D² [s²] (never infinite or negative) and the modes
    U Σ P. With all modes kept, the subspace is that of the velocities' proper orthogonal modes.

    **Arguments:** as `pod`; `rank` and `tol` refer to the singular values of the weighted
    velocities. A smooth mode that oscillates alone has the frequency 1/(2π √λ) [Hz].

    Raises ValueError if the snapshots do not move, are not finite, or do not allow the rank.
    """
    snapshots = weigh(motion, offset)
    vectors, sigma, _ = jnp.linalg.svd(snapshots.velocities, full_matrices=False)
    chosen = choose_rank("sod", sigma, rank, tol, snapshots.velocities.shape[1])
    kept, values = _smooth(snapshots, vectors[:, : chosen.rank], sigma[: chosen.rank])
    return build(motion, snapshots, kept, values, sigma, "SOD", chosen.reason)


@jax.jit
def _smooth(
    snapshots: Snapshots, vectors: Float[Array, "n r"], sigma: Float[Array, " r"]
) -> tuple[Float[Array, "n r"], Float[Array, " r"]]:
    """Orthonormal vectors of the smooth modes, in the order of their values, and the values."""
    seen = vectors.T @ snapshots.positions / sigma[:, None]
    p, d, _ = jnp.linalg.svd(seen, full_matrices=False)
    # Only the span counts for the reduction.
    orthonormal, _ = jnp.linalg.qr(vectors @ (sigma[:, None] * p))
    return orthonormal, d**2
