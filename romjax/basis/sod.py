"""Smooth orthogonal decomposition, with a rank that does not flip."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .basis import Basis
from .pod import build
from .rank import Rank, choose_rank
from .snapshots import Motion, weigh


def sod(
    motion: Motion,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: ArrayLike | None = None,
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
    snapshots = weigh(motion, None if offset is None else jnp.asarray(offset))
    vectors, sigma, _ = jnp.linalg.svd(snapshots.velocities, full_matrices=False)
    chosen = choose_rank("sod", sigma, rank, tol, snapshots.velocities.shape[1])
    u, s = vectors[:, : chosen.rank], sigma[: chosen.rank]
    p, d, _ = jnp.linalg.svd(u.T @ snapshots.positions / s[:, None], full_matrices=False)
    # Only the span counts for the reduction: orthonormal, in the order of the smooth values.
    orthonormal, _ = jnp.linalg.qr(u @ (s[:, None] * p))
    return build(motion, snapshots, orthonormal, d**2, sigma, "SOD", chosen.reason)
