"""Proper orthogonal decomposition."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .basis import Basis
from .rank import Rank, choose_rank
from .snapshots import Motion, Snapshots, weigh


def pod(
    motion: Motion,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: ArrayLike | None = None,
) -> Basis:
    """Proper orthogonal modes and values of a motion (chapter equation 39.8).

    The modes are the left singular vectors of the snapshots q − q̄, weighted by mass and time, so
    that the values mean energy-norm amplitude and do not depend on units or sample rate.

    **Arguments:**

    - `motion`: a Trajectory.
    - `rank`: number of modes, or "drop": where the values fall most steeply (the default).
    - `tol`: instead of a rank, keep the values above `tol` times the largest.
    - `offset`: q̄ (n,), the first configuration unless given.

    Raises ValueError if the snapshots do not move, are not finite, or do not allow the rank.
    """
    snapshots, vectors, values = _decompose(motion, offset)
    chosen = choose_rank("pod", values, rank, tol, snapshots.positions.shape[1])
    return build(motion, snapshots, vectors[:, : chosen.rank], values, values, "POD", chosen.reason)


@jax.jit
def _decompose(
    motion: Motion, offset: ArrayLike | None
) -> tuple[Snapshots, Float[Array, "n k"], Float[Array, " k"]]:
    snapshots = weigh(motion, None if offset is None else jnp.asarray(offset))
    vectors, values, _ = jnp.linalg.svd(snapshots.positions, full_matrices=False)
    return snapshots, vectors, values


@functools.partial(jax.jit, static_argnames=("kind", "reason"))
def build(
    motion: Motion,
    snapshots: Snapshots,
    vectors: Float[Array, "n r"],
    values: Float[Array, " k"],
    spectrum: Float[Array, " s"],
    kind: str,
    reason: str,
) -> Basis:
    """The Basis of orthonormal `vectors` in weighted coordinates, with reproducible signs."""
    modes = snapshots.unweight(vectors)
    largest = jnp.take_along_axis(modes, jnp.argmax(jnp.abs(modes), axis=0)[None], axis=0)
    sign = jnp.where(largest < 0, -1.0, 1.0).astype(modes.dtype)
    inside = vectors.T @ snapshots.positions
    # Norms by way of max(…, tiny), whose gradient exists where nothing leaks or moves.
    tiny = jnp.finfo(modes.dtype).tiny
    missed = jnp.sum((snapshots.positions - vectors @ inside) ** 2)
    moved = jnp.sum(snapshots.positions**2)
    shifted = snapshots.root @ (motion.q - snapshots.offset).T
    return Basis(
        modes=modes * sign,
        offset=snapshots.offset,
        values=values,
        spectrum=spectrum,
        coordinates=shifted.T @ vectors * sign,
        t=motion.t,
        leak=jnp.sqrt(jnp.maximum(missed, tiny) / jnp.maximum(moved, tiny)),
        kind=kind,
        reason=reason,
        labels=motion.labels,
    )
