"""Smooth orthogonal decomposition, with a rank that does not flip."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from ..basis import Basis
from ..build import build
from ..rank import FLOOR, Rank, choose_rank
from ..snapshots import Motion, Recording, Snapshots, weigh
from ..subspace import leading, singular_values


def sod(
    motion: Motion | Sequence[Motion],
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
    recording = Recording.of(motion)
    snapshots = weigh(recording, offset)
    found = singular_values(snapshots.velocities)
    noise = recording.noise.velocities
    chosen = choose_rank("sod", found, rank, tol, FLOOR[found.dtype], noise)
    vectors, sigma = leading(snapshots.velocities, chosen.rank)
    kept, values = _smooth(snapshots, vectors)
    return build(recording, snapshots, kept, values, sigma, "SOD", chosen)


@jax.jit
def _smooth(
    snapshots: Snapshots, vectors: Float[Array, "n r"]
) -> tuple[Float[Array, "n r"], Float[Array, " r"]]:
    """Orthonormal vectors of the smooth modes, in the order of their values, and the values."""
    # Up to signs R is Σ; but it follows when a derivative mixes the vectors.
    _, r = jnp.linalg.qr(snapshots.velocities.T @ vectors)
    seen = jsl.solve_triangular(r, vectors.T @ snapshots.positions, trans=1)
    p, d = leading(seen, vectors.shape[1])
    # All smooth modes are kept, so they span what the velocities' vectors span: how they mix these
    # is no matter of the subspace's derivative.
    mix, _ = jnp.linalg.qr(jax.lax.stop_gradient(r.T @ p))
    return vectors @ mix, d**2
