"""From orthonormal vectors in weighted coordinates to a Basis."""

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from .basis import Basis
from .rank import Choice
from .snapshots import Recording, Snapshots


def build(
    recording: Recording,
    snapshots: Snapshots,
    vectors: Float[Array, "n r"],
    values: Float[Array, " k"],
    spectrum: Float[Array, " s"],
    kind: str,
    chosen: Choice,
) -> Basis:
    """The Basis of orthonormal `vectors`."""
    return Basis(
        modes=modes_of(snapshots.root, vectors),
        offset=snapshots.offset,
        values=values,
        spectrum=spectrum,
        recording=recording,
        leak=_leak(snapshots.positions, vectors),
        kind=kind,
        reason=chosen.reason,
        floor=chosen.floor,
        tol=chosen.tol,
    )


@jax.jit
def modes_of(root: Float[Array, "n n"], vectors: Float[Array, "n r"]) -> Float[Array, "n r"]:
    """Modes orthonormal in the metric rootᵀ root; the largest component of each is positive."""
    modes = jsl.solve_triangular(root, vectors)
    largest = jnp.take_along_axis(modes, jnp.argmax(jnp.abs(modes), axis=0)[None], axis=0)
    return modes * jnp.where(largest < 0, -1.0, 1.0).astype(modes.dtype)


@jax.jit
def _leak(positions: Float[Array, "n h"], vectors: Float[Array, "n r"]) -> Float[Array, ""]:
    missed = jnp.sum((positions - vectors @ (vectors.T @ positions)) ** 2)
    moved = jnp.sum(positions**2)
    # A root by way of max(…, tiny), whose gradient exists where nothing leaks or moves.
    tiny = jnp.finfo(positions.dtype).tiny
    return jnp.sqrt(jnp.maximum(missed / jnp.maximum(moved, tiny), tiny))
