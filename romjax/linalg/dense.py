"""Batches of small dense matrices, as arithmetic that XLA fuses: no library call for each."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Up to here an elimination takes one row after the other, beyond several at once. XLA compiles its
# loop together with the loops around it. LAPACK's it cannot, which takes as long as a 6 × 6 inverse
# to call, and its threads wait for each other: 48 rows take 0.1 ms alone, 3 ms on a busy machine.
_BY_ROWS = 6
# Rows that a step of the loop eliminates: the matrix is read and written once for all of them. The
# second where it has more rows than the third, and no longer fits into a core's cache.
_BLOCK, _WIDE_BLOCK, _WIDE = 4, 32, 128
# Up to here a sum of products is written so that XLA fuses it with what is around it. Beyond, a
# library's product is faster, since a fused one computes its factors again for each entry. The
# limits: terms of each sum; and for a single matrix, its entries, and the products in all.
_FUSED, _ENTRIES, _PRODUCTS = 16, 100, 600
# Steps of Schulz's iteration, each of which squares the error, and of refinement, which halves it
# at least where the method of simplified Newton steps converges. Eight squarings take 0.87 to
# rounding, and a double has 52 bits to halve.
_MOST_ITERATIONS, _MOST_REFINED = 8, 60


def multiply(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Products a b, as `a @ b`; for small ones, whose code a library's product would only lengthen.

    XLA writes each product of a few numbers out as a function of its own, which takes it longer to
    compile than a sum, and longer to start than to run.

    `a` (..., p, c) or (c,), `b` (..., c, q) or (c,).
    """
    if a.ndim == 1:
        if b.ndim == 1 and a.size <= _FUSED:
            return _sum_of_products(a, b, 0)
        if b.ndim == 1:
            return a @ b
        product = multiply(_with_axis(a, 0), b)
        return jax.lax.squeeze(product, (product.ndim - 2,))
    if b.ndim == 1:
        product = multiply(a, _with_axis(b, 1))
        return jax.lax.squeeze(product, (product.ndim - 1,))
    large = a.ndim == 2 and (a.size > _ENTRIES or a.size * b.shape[-1] > _PRODUCTS)
    if large or a.shape[-1] > _FUSED:
        return a @ b
    a, b = _with_axis(a, a.ndim), _with_axis(b, b.ndim - 2)
    return _sum_of_products(a, b, max(a.ndim, b.ndim) - 2)


def _with_axis(a: Array, axis: int) -> Array:
    return jax.lax.expand_dims(a, (axis,))


def _sum_of_products(a: Array, b: Array, axis: int) -> Array:
    if a.ndim != b.ndim or a.dtype != b.dtype:
        return jnp.sum(a * b, axis=axis)
    # The same operations, without what JAX's NumPy traces around each: programs have hundreds of
    # these products, and tracing a run takes a tenth less.
    return jax.lax.reduce_sum(jax.lax.mul(a, b), (axis,))


def multiply_transposed(
    a: Float[Array, "... c p"], b: Float[Array, "... c q"]
) -> Float[Array, "..."]:
    """Products aᵀ b."""
    return multiply(jnp.swapaxes(a, -1, -2), b)


def invert(a: Float[Array, "*batch b b"]) -> Float[Array, "*batch b b"]:
    """Inverses of symmetric positive definite matrices."""
    size = a.shape[-1]
    if size == 2:  # most joints have two rows
        # Cramer's rule: reversing both axes swaps the entries of the diagonal, and those beside it,
        # which are equal, change their signs.
        determinant = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] ** 2
        signs = np.array([[1, -1], [-1, 1]], a.dtype).reshape(*[1] * (a.ndim - 2), 2, 2)
        return a[..., ::-1, ::-1] * signs / determinant[..., None, None]
    return 1 / a if size < 2 else _eliminated(a)


@jax.custom_jvp
def _eliminated(a: Float[Array, "*batch b b"]) -> Float[Array, "*batch b b"]:
    size = a.shape[-1]
    if size > _BY_ROWS:
        return _invert_by_blocks(a)
    # A loop: written out, the steps are a tenth of a mechanism's program, and no faster.
    inverse: Float[Array, "*batch b b"] = jax.lax.fori_loop(0, size, _eliminate_row, a)
    return inverse


@_eliminated.defjvp
def _slope_of_inverse(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """d(A⁻¹) = −A⁻¹ dA A⁻¹; in reverse mode the loop would store all its steps."""
    inverse = _eliminated(*primals)
    return inverse, -multiply(multiply(inverse, *tangents), inverse)


def _eliminate_row(i: Array, a: Float[Array, "*batch b b"]) -> Float[Array, "*batch b b"]:
    """A step of Gauss–Jordan in place; without pivoting, for positive definite matrices."""
    at = np.arange(a.shape[-1]) == i
    own = jax.lax.dynamic_index_in_dim(a, i, axis=-2, keepdims=False)
    column = jax.lax.dynamic_index_in_dim(a, i, axis=-1, keepdims=False)
    # With the pivot p, row i becomes 1/p in its own column and a_ij / p elsewhere, other rows lose
    # a_ki times that, and a_ki becomes −a_ki / p. A one and zeros that are put there first make it
    # one formula.
    row = jnp.where(at, 1, own) / jax.lax.dynamic_index_in_dim(own, i, axis=-1)
    others = jnp.where(at, 0, a) - column[..., None] * row[..., None, :]
    return jnp.where(at[:, None], row[..., None, :], others)


def _invert_by_blocks(a: Float[Array, "*batch b b"]) -> Float[Array, "*batch b b"]:
    """Gauss–Jordan in place by diagonal blocks P of a few rows: with the rows R and the columns S
    of the block, R ← P⁻¹ R, the other rows lose S P⁻¹ R, S ← −S P⁻¹, P ← P⁻¹.
    """
    size, batch = a.shape[-1], a.shape[:-2]
    block = _BLOCK if size <= _WIDE else _WIDE_BLOCK
    more = -size % block
    if more:  # the last block is filled up by a unit matrix
        a = jnp.pad(a, [(0, 0)] * len(batch) + [(0, more)] * 2)
        a += np.broadcast_to(np.diag(np.arange(size + more) >= size).astype(a.dtype), a.shape)
    nothing = jnp.zeros((*batch, size + more, block), a.dtype)
    put = jax.lax.dynamic_update_slice_in_dim

    def eliminate(a: Array, first: Array) -> tuple[Array, None]:
        rows = jax.lax.dynamic_slice_in_dim(a, first, block, axis=-2)
        columns = jax.lax.dynamic_slice_in_dim(a, first, block, axis=-1)
        inverse = invert(jax.lax.dynamic_slice_in_dim(rows, first, block, axis=-1))
        # P⁻¹ R with P⁻¹ in the block itself. Its own rows lose nothing, and its columns are zero
        # before the product is taken from them, which leaves −S P⁻¹ there.
        rows = put(multiply(inverse, rows), inverse, first, axis=-1)
        columns = put(columns, nothing[..., :block, :], first, axis=-2)
        a = put(a, nothing, first, axis=-1)
        a -= _product(columns, rows)
        return put(a, rows, first, axis=-2), None

    firsts = jnp.arange(0, size + more, block)
    return jax.lax.scan(eliminate, a, firsts)[0][..., :size, :size]


@jax.custom_jvp
def invert_any(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The inverse of a matrix that need not be symmetric: Gauss–Jordan with the largest pivot."""
    if len(a) > _WIDE:
        return _invert_any_by_blocks(a)
    size = len(a)
    rows = np.arange(size)

    def eliminate(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        a, order = carry
        column, at = a[:, i], rows == i
        # Rows before i are pivots already; −1 is less than the size of any candidate.
        pivot = jnp.argmax(jnp.where(rows < i, -1.0, jnp.abs(column)))
        to = rows == pivot
        row = jnp.where(at, 1, a[pivot]) / column[pivot]
        swapped = jnp.where(to[:, None], a[i][None], a)
        column = jnp.where(to, column[i], column)
        others = jnp.where(at[None], 0, swapped) - column[:, None] * row[None]
        order = jnp.where(at, order[pivot], jnp.where(to, order[i], order))
        return jnp.where(at[:, None], row[None], others), order

    a, order = jax.lax.fori_loop(0, size, eliminate, (a, jnp.arange(size)))
    # The inverse of the rows in their order has its columns in that order. (Not by `argsort`, which
    # no function of a program may contain.)
    position = jnp.sum(jnp.where(order[:, None] == rows[None], rows[:, None], 0), axis=0)
    return a[:, position]


def _invert_any_by_blocks(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Gauss–Jordan in place by blocks of columns: of each, as many rows as it has columns are its
    pivots, those that elimination with the largest pivot takes, and stay where they are.
    """
    size, block = len(a), _WIDE_BLOCK
    more = -size % block
    a = jnp.pad(a, [(0, more)] * 2) + np.diag(np.arange(size + more) >= size).astype(a.dtype)
    # Unlike the elimination by rows, this one swaps none, so that it has to remember which rows are
    # free.
    places = np.arange(size + more)

    def choose(i: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        columns, free, chosen = carry
        column = jax.lax.dynamic_index_in_dim(columns, i, axis=1, keepdims=False)
        pivot = jnp.argmax(jnp.where(free, jnp.abs(column), -1.0))
        row = columns[pivot] / column[pivot]
        columns -= jnp.where(places == pivot, 0, column)[:, None] * row[None]
        return columns, free & (places != pivot), chosen.at[i].set(pivot)

    def eliminate(carry: tuple[Array, Array], first: Array) -> tuple[tuple[Array, Array], Array]:
        a, free = carry
        columns = jax.lax.dynamic_slice_in_dim(a, first, block, axis=1)
        start = (columns, free, jnp.zeros(block, int))
        _, free, chosen = jax.lax.fori_loop(0, block, choose, start)
        inverse = invert_any(columns[chosen])
        rows = jax.lax.dynamic_update_slice_in_dim(inverse @ a[chosen], inverse, first, axis=1)
        a = jax.lax.dynamic_update_slice_in_dim(a, jnp.zeros_like(columns), first, axis=1)
        a -= columns.at[chosen].set(0) @ rows
        return (a.at[chosen].set(rows), free), chosen

    start = (a, jnp.ones(size + more, bool))
    (a, _), order = jax.lax.scan(eliminate, start, jnp.arange(0, size + more, block))
    # Row `order[i]` holds unknown i, and column j belongs to the right-hand side of `order[j]`.
    a = a[order.ravel()]
    return jnp.zeros_like(a).at[:, order.ravel()].set(a)[:size, :size]


def _product(a: Float[Array, "*batch p c"], b: Float[Array, "*batch c q"]) -> Float[Array, "..."]:
    """Products a b, fused where they have few terms, however many entries."""
    if a.shape[-1] > _FUSED:
        return a @ b
    return jnp.sum(a[..., None] * b[..., None, :, :], axis=-2)


@invert_any.defjvp
def _change_of_inverse(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """d(A⁻¹) = −A⁻¹ dA A⁻¹."""
    inverse = invert_any(*primals)
    return inverse, -multiply(multiply(inverse, tangents[0]), inverse)


def improve_inverse(
    inverse: Float[Array, "m m"], matrix: Float[Array, "m m"]
) -> Float[Array, "m m"]:
    """The inverse of a matrix A from that of a similar one.

    X ← X + X (I − A X) squares the error I − A X (Schulz 1933, doi:10.1002/zamm.19330130111).
    Products only: a library's factorisation takes longer than all the iterations.
    """
    unit = jnp.eye(len(matrix), dtype=matrix.dtype)
    # The next iteration squares this to rounding.
    enough = jnp.finfo(matrix.dtype).eps ** 0.5

    def unfinished(carry: Any) -> Array:
        _, error, count = carry
        more: Array = (error > enough) & (count < _MOST_ITERATIONS)
        return more

    def square(carry: Any) -> Any:
        inverse, _, count = carry
        error = unit - multiply(matrix, inverse)
        return inverse + multiply(inverse, error), jnp.max(jnp.abs(error)), count + 1

    start = (inverse, jnp.full_like(inverse[0, 0], jnp.inf), 0)
    improved: Array = jax.lax.while_loop(unfinished, square, start)[0]
    return improved


def solve_by_inverse(
    matrix: Float[Array, "m m"], inverse: Float[Array, "m m"], right: Float[Array, "m *k"]
) -> Float[Array, "m *k"]:
    """A⁻¹ b by a given inverse; the derivative is that of the solution of A x = b."""
    solution: Float[Array, m * k] = jax.lax.custom_linear_solve(
        lambda x: multiply(matrix, x),
        right,
        lambda _, right: multiply(inverse, right),
        lambda _, right: multiply(inverse.T, right),
    )
    return solution


def solve_by_similar(
    matrix: Float[Array, "m m"], inverse: Float[Array, "m m"], right: Float[Array, "m *k"]
) -> Float[Array, "m *k"]:
    """A⁻¹ b by X, the inverse of a similar matrix: x ← x + X (b − A x), for few b in less time than
    A takes to invert. The derivative is that of the solution of A x = b.
    """
    # A step of two units in the last place changes nothing but the rounding of x.
    enough = 2 * jnp.finfo(matrix.dtype).eps

    def refined(matrix: Array, inverse: Array, right: Array) -> Array:
        def unfinished(carry: Any) -> Array:
            x, change, count = carry
            more: Array = (change > enough * jnp.max(jnp.abs(x))) & (count < _MOST_REFINED)
            return more

        def refine(carry: Any) -> Any:
            x, _, count = carry
            step = multiply(inverse, right - multiply(matrix, x))
            return x + step, jnp.max(jnp.abs(step), initial=0.0), count + 1

        start = (jnp.zeros_like(right), jnp.asarray(jnp.inf, right.dtype), 0)
        solution: Array = jax.lax.while_loop(unfinished, refine, start)[0]
        return solution

    solution: Float[Array, m * k] = jax.lax.custom_linear_solve(
        lambda x: multiply(matrix, x),
        right,
        lambda _, right: refined(matrix, inverse, right),
        lambda _, right: refined(matrix.T, inverse.T, right),
    )
    return solution


def length(x: Float[Array, "*rows k"]) -> Float[Array, "*rows"]:
    """|x| of a vector, or of each row; its derivative at zero, where it has none, is zero."""
    squared = jnp.sum(x**2, axis=-1)
    # NaN is none, and stays.
    is_zero = squared == 0
    return jnp.where(is_zero, 0.0, jnp.sqrt(jnp.where(is_zero, 1.0, squared)))
