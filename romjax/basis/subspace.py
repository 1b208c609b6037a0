"""The leading left singular subspace of a matrix, with a derivative that is right."""

import functools
import warnings
from typing import Literal

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..common import compat
from ..common.arrays import pick
from ..compiling.program import program

Method = Literal["svd", "gram"]
# The share of the last kept singular value that the first dropped one may reach before derivatives
# of the subspace tell nothing: they grow with 1/(1 − share).
CLOSE = 0.9
# Vectors whose singular values are below this share of the largest depend on each other.
DEPENDENT = 1e-6


def leading(
    matrix: Float[Array, "n h"], rank: int, method: Method = "svd"
) -> tuple[Float[Array, "n r"], Float[Array, " k"]]:
    """The first `rank` left singular vectors, and all singular values, largest first.

    `method`: "svd"; or "gram", by the eigenvalue problem of the smaller of A Aᵀ and Aᵀ A (chapter
    equations 39.9, 39.10), which is cheaper for long thin matrices and blind below 1e-7 of the
    largest value.

    The derivative is that of the *subspace*: vectors move orthogonally to all kept ones. It is
    exact for whatever does not change when the vectors are mixed among each other, a reduced motion
    for one, and exists where kept or dropped values repeat. `jnp.linalg.svd` differentiates the
    single vectors: 5 % wrong in silence, or NaN, there. A warning tells when the last kept and the
    first dropped value are too close. Equal ones, between which no derivative exists, give the
    finite part.
    """
    if method == "gram" or not compat.is_outermost():
        return _program_of_leading(matrix, rank, method)
    # All of them are computed in any case: one program does for every rank.
    vectors, values = _program_of_leading(matrix, min(matrix.shape), method)
    return pick(vectors, np.s_[:, :rank]), values


@functools.partial(jax.custom_jvp, nondiff_argnums=(1, 2))
def _leading(
    matrix: Float[Array, "n h"], rank: int, method: Method
) -> tuple[Float[Array, "n r"], Float[Array, " k"]]:
    if method == "gram":
        return _by_gram(matrix, rank)
    vectors, values, _ = jnp.linalg.svd(matrix, full_matrices=False)
    return vectors[:, :rank], values


_program_of_leading = program(_leading)


@_leading.defjvp
def _leading_jvp(
    rank: int, method: Method, primals: tuple[Array], tangents: tuple[Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (matrix,), (change,) = primals, tangents
    u, values, vt = jnp.linalg.svd(matrix, full_matrices=False)
    kept, dropped = values[:rank], values[rank:]
    if dropped.size:
        jax.debug.callback(_warn_if_close, kept[-1], dropped[0])
    # In the metric of all left and right vectors.
    inside = u.T @ change @ vt.T
    # σ_k² − σ_d², as a product: the difference of squares would lose the digits of close values.
    gap = (kept[None] - dropped[:, None]) * (kept[None] + dropped[:, None])
    coupling = inside[rank:, :rank] * kept[None] + dropped[:, None] * inside[:rank, rank:].T
    # The kept vectors turn towards the dropped ones.
    tangent = u[:, rank:] @ (coupling * _inverse(gap))
    # What no left vector spans: with fewer columns than rows, the larger part.
    image = change @ vt[:rank].T
    tangent += (image - u @ (u.T @ image)) * _inverse(kept)[None]
    if method == "gram":
        # Its vectors may have other signs, and mix those of equal values.
        vectors, values = _by_gram(matrix, rank)
        return (vectors, values), (tangent @ (u[:, :rank].T @ vectors), jnp.diagonal(inside))
    return (u[:, :rank], values), (tangent, jnp.diagonal(inside))


@program
def singular_values(matrix: Float[Array, "n h"], method: Method = "svd") -> Float[Array, " k"]:
    """All singular values, largest first, as numbers to decide by: they carry no derivative."""
    matrix = jax.lax.stop_gradient(matrix)
    if method == "svd":
        return jnp.linalg.svd(matrix, full_matrices=False, compute_uv=False)
    return jnp.sqrt(jnp.maximum(jnp.linalg.eigvalsh(_gram(matrix))[::-1], 0))


def span(vectors: Float[Array, "n r"], metric: Float[Array, "n n"]) -> Float[Array, "n k"]:
    """A basis of the span of vectors, orthonormal in a metric, the first along the first vector.

    Vectors that depend on others to `DEPENDENT` count once; while JAX traces, all count.
    """
    values, rank = _values_of_span(vectors, metric), min(vectors.shape)
    if not compat.is_traced(values):
        sizes = np.asarray(values)
        rank = int(np.sum(sizes > DEPENDENT * sizes[0]))
    return _span(vectors, metric, rank)


@program
def _values_of_span(vectors: Float[Array, "n r"], metric: Float[Array, "n n"]) -> Array:
    return singular_values(jnp.linalg.cholesky(metric).T @ vectors)


@program
def _span(vectors: Float[Array, "n r"], metric: Float[Array, "n n"], rank: int) -> Array:
    root = jnp.linalg.cholesky(metric).T
    weighted = root @ vectors
    orthonormal, _ = leading(weighted, rank)
    # How the span's vectors are mixed is no matter of its derivative.
    # The orthonormal vectors nearest in order to the given ones, so that the same span has the same
    # basis.
    turn, _ = jnp.linalg.qr(jax.lax.stop_gradient(orthonormal.T @ weighted)[:, :rank])
    return jsl.solve_triangular(root, orthonormal @ turn)


def _gram(matrix: Float[Array, "n h"]) -> Float[Array, "k k"]:
    tall = matrix.shape[0] > matrix.shape[1]
    return matrix.T @ matrix if tall else matrix @ matrix.T


def _by_gram(
    matrix: Float[Array, "n h"], rank: int
) -> tuple[Float[Array, "n r"], Float[Array, " k"]]:
    squares, vectors = jnp.linalg.eigh(_gram(matrix))
    squares, vectors = squares[::-1], vectors[:, ::-1][:, :rank]
    # Squaring has cost half of the digits; a step of subspace iteration brings them back.
    short = vectors.shape[0] == matrix.shape[0]
    basis, _ = jnp.linalg.qr(vectors if short else matrix @ vectors)
    basis, _ = jnp.linalg.qr(matrix @ (matrix.T @ basis))
    turn, values, _ = jnp.linalg.svd(basis.T @ matrix, full_matrices=False)
    dropped = jnp.sqrt(jnp.maximum(squares[rank:], 0))
    return basis @ turn, jnp.concatenate([values, jnp.minimum(dropped, values[-1])])


def _inverse(x: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.where(x > 0, 1 / jnp.where(x > 0, x, 1), 0)


def _warn_if_close(kept: ArrayLike, dropped: ArrayLike) -> None:
    kept, dropped = np.asarray(kept), np.asarray(dropped)
    if np.any(dropped > CLOSE * kept):
        warnings.warn(
            f"The derivative of a subspace is ill-determined: its last singular value is "
            f"{np.max(kept):.3g} and the first dropped one {np.max(dropped):.3g}; choose a rank "
            "at a larger gap.",
            stacklevel=2,
        )
