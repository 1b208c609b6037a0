"""Factors of a sparse symmetric positive definite matrix of small blocks, in linear time."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .dense import invert, multiply, multiply_transposed
from .ordering import Edge, Schedule, order

Pair = tuple[Array, Array]
Carry = TypeVar("Carry")
Levels = TypeVar("Levels")
Out = TypeVar("Out")

_WRITTEN_OUT = 6  # levels; a chain of 32 has as many


class Factor(eqx.Module):
    """The factors of a matrix A with blocks on the diagonal and at the edges of a graph.

    What is factored is P A Pᵀ = L Δ Lᵀ, with the permutation P of a schedule, L of unit blocks on
    its diagonal and Δ block-diagonal. A node i of a level has the pivot Δ_i = A_ii and the row
    (Lᵀ)_ij = A_ii⁻¹ A_ij; its elimination subtracts A_ji A_ii⁻¹ A_ik from the blocks of its
    neighbours j and k. Pivots are inverted, not factored again: they are small, and products with
    an inverse are fused where triangular solves are not.

    A level reads the blocks of its couplings from the list of all edges (i, j) with i < j,
    followed by their transposes.

    **Arguments:**

    - `diagonal`: the blocks A_ii, symmetric; `couplings`: the blocks A_ij of the `edges`, i < j.
    """

    inverses: Float[Array, "levels width b b"]  # Δ_i⁻¹
    rows: Float[Array, "levels width degree b b"]  # Δ_i⁻¹ A_ij
    nodes: int = eqx.field(static=True)
    edges: tuple[Edge, ...] = eqx.field(static=True)

    def __init__(
        self,
        diagonal: Float[Array, "nodes b b"],
        couplings: Float[Array, "edges b b"],
        edges: tuple[Edge, ...],
    ):
        self.nodes, self.edges = len(diagonal), edges
        schedule, filled = order(self.nodes, edges)
        shape = diagonal.shape[1:]
        fill = jnp.zeros((filled - len(edges), *shape), diagonal.dtype)

        def level(carry: Pair, at: Schedule) -> tuple[Pair, Pair]:
            diagonal, couplings = carry
            both = jnp.concatenate([couplings, jnp.swapaxes(couplings, 1, 2)])
            inverse, own = invert(diagonal[at.nodes]), _padded(both)[at.couplings]
            rows = multiply(inverse[:, None], own)
            products = multiply_transposed(own[:, :, None], rows[:, None])
            flat = _padded(products.reshape(-1, *shape))
            diagonal -= jnp.sum(flat[at.onto_nodes], axis=1)
            couplings -= jnp.sum(flat[at.onto_edges], axis=1)
            return (diagonal, couplings), (inverse, rows)

        start = (diagonal, jnp.concatenate([couplings, fill]))
        _, (self.inverses, self.rows) = _each(level, start, schedule)

    def pivots(self) -> Float[Array, " rows"]:
        """What elimination leaves of each diagonal element, given all others of its block."""
        diagonal: Float[Array, " rows"] = (
            1 / jnp.diagonal(self.inverses, axis1=-2, axis2=-1).ravel()
        )
        return diagonal

    def solve(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution x of A x = `right`: L y = right from the first level to the last, then
        Lᵀ x = Δ⁻¹ y from the last to the first.
        """
        schedule, _ = order(self.nodes, self.edges)

        def forward(right: Array, xs: tuple[Schedule, Array]) -> Pair:
            at, rows = xs
            own = right[at.nodes]
            passed = multiply_transposed(rows, own[:, None])
            passed = _padded(passed.reshape(-1, *right.shape[1:]))
            return right - jnp.sum(passed[at.onto_sides], axis=1), own

        def backward(x: Array, xs: tuple[Schedule, Array, Array, Array]) -> tuple[Array, None]:
            at, inverse, rows, own = xs
            later = jnp.sum(multiply(rows, x[at.neighbours]), axis=1)
            return x + _padded(multiply(inverse, own) - later)[at.position], None

        _, own = _each(forward, right, (schedule, self.rows))
        levels = (schedule, self.inverses, self.rows, own)
        x, _ = _each(backward, jnp.zeros_like(right), levels, reverse=True)
        return x


def _each(
    step: Callable[[Carry, Levels], tuple[Carry, Out]],
    start: Carry,
    xs: Levels,
    reverse: bool = False,
) -> tuple[Carry, Out]:
    # Traced once, whatever the number of levels. A few are written out for XLA, which then knows
    # the tables, in half the time of a loop; more would take it longer to compile.
    written_out = len(jax.tree.leaves(xs)[0]) <= _WRITTEN_OUT
    return jax.lax.scan(step, start, xs, reverse=reverse, unroll=written_out or 1)


def _padded(x: Float[Array, "size *shape"]) -> Float[Array, "one_more *shape"]:
    return jnp.concatenate([x, jnp.zeros((1, *x.shape[1:]), x.dtype)])
