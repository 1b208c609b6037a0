"""From orthonormal vectors in weighted coordinates to a Basis."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from .basis import Basis
from .snapshots import Motion, Snapshots


class _Parts(NamedTuple):
    modes: Float[Array, "n r"]
    coordinates: Float[Array, "h r"]
    leak: Float[Array, ""]


def build(
    motion: Motion,
    snapshots: Snapshots,
    vectors: Float[Array, "n r"],
    values: Float[Array, " k"],
    spectrum: Float[Array, " s"],
    kind: str,
    reason: str,
) -> Basis:
    """The Basis of orthonormal `vectors`; the largest component of each mode is positive."""
    parts = _parts(snapshots, vectors)
    return Basis(
        modes=parts.modes,
        offset=snapshots.offset,
        values=values,
        spectrum=spectrum,
        coordinates=parts.coordinates,
        t=motion.t,
        leak=parts.leak,
        kind=kind,
        reason=reason,
        labels=motion.labels,
    )


@jax.jit
def _parts(snapshots: Snapshots, vectors: Float[Array, "n r"]) -> _Parts:
    modes = jsl.solve_triangular(snapshots.root, vectors)
    largest = jnp.take_along_axis(modes, jnp.argmax(jnp.abs(modes), axis=0)[None], axis=0)
    sign = jnp.where(largest < 0, -1.0, 1.0).astype(modes.dtype)
    inside = vectors.T @ snapshots.positions
    # Norms by way of max(…, tiny), whose gradient exists where nothing leaks or moves.
    tiny = jnp.finfo(modes.dtype).tiny
    missed = jnp.maximum(jnp.sum((snapshots.positions - vectors @ inside) ** 2), tiny)
    moved = jnp.maximum(jnp.sum(snapshots.positions**2), tiny)
    coordinates = (inside / snapshots.weights[None]).T * sign
    return _Parts(modes * sign, coordinates, jnp.sqrt(missed / moved))
