"""Modes from orthonormal vectors in weighted coordinates, and the residual that they leave."""

import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from ..compiling.program import program


@program
def modes_of(root: Float[Array, "n n"], vectors: Float[Array, "n r"]) -> Float[Array, "n r"]:
    """Modes orthonormal in the metric rootᵀ root; the largest component of each is positive."""
    modes = jsl.solve_triangular(root, vectors)
    largest = jnp.take_along_axis(modes, jnp.argmax(jnp.abs(modes), axis=0)[None], axis=0)
    return modes * jnp.where(largest < 0, -1.0, 1.0).astype(modes.dtype)


@program
def projection_error(
    positions: Float[Array, "n h"], vectors: Float[Array, "n r"]
) -> Float[Array, ""]:
    """‖X − V Vᵀ X‖ / ‖X‖ of weighted snapshots X and orthonormal vectors V."""
    missed = jnp.sum((positions - vectors @ (vectors.T @ positions)) ** 2)
    total = jnp.sum(positions**2)
    # A root by way of max(…, tiny), whose gradient exists where nothing is missed or moves.
    tiny = jnp.finfo(positions.dtype).tiny
    return jnp.sqrt(jnp.maximum(missed / jnp.maximum(total, tiny), tiny))
