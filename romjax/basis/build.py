"""Modes from orthonormal vectors in weighted coordinates, and the residual that they leave."""

import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, pick
from ..common.compat import is_traced
from ..compiling.program import program


def modes_of(root: Float[Array, "n n"], vectors: Float[Array, "n r"]) -> Float[Array, "n r"]:
    """Modes orthonormal in the metric rootᵀ root; the largest component of each is positive."""
    return pick(_modes_of(root, _filled(vectors)), np.s_[:, : vectors.shape[1]])


def projection_error(
    positions: Float[Array, "n h"], vectors: Float[Array, "n r"]
) -> Float[Array, ""]:
    """‖X − V Vᵀ X‖ / ‖X‖ of weighted snapshots X and orthonormal vectors V."""
    return _projection_error(positions, _filled(vectors))


def _filled(vectors: Float[Array, "n r"]) -> Float[Array, "n k"]:
    """The vectors and zeros, n in all, so that one program does for every number of them."""
    n, count = vectors.shape
    if is_traced(vectors):
        return vectors
    filled = np.zeros((n, max(n, count)), vectors.dtype)
    filled[:, :count] = vectors
    return as_jax(filled)


@program
def _modes_of(root: Float[Array, "n n"], vectors: Float[Array, "n r"]) -> Float[Array, "n r"]:
    modes = jsl.solve_triangular(root, vectors)
    largest = jnp.take_along_axis(modes, jnp.argmax(jnp.abs(modes), axis=0)[None], axis=0)
    return modes * jnp.where(largest < 0, -1.0, 1.0).astype(modes.dtype)


@program
def _projection_error(
    positions: Float[Array, "n h"], vectors: Float[Array, "n r"]
) -> Float[Array, ""]:
    missed = jnp.sum((positions - vectors @ (vectors.T @ positions)) ** 2)
    total = jnp.sum(positions**2)
    # A root by way of max(…, tiny), whose gradient exists where nothing is missed or moves.
    tiny = jnp.finfo(positions.dtype).tiny
    return jnp.sqrt(jnp.maximum(missed / jnp.maximum(total, tiny), tiny))
