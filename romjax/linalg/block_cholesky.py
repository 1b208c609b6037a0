"""Factors of a sparse symmetric positive definite matrix of small blocks, in linear time."""

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import invert, multiply, multiply_transposed
from .indexing import take
from .ordering import Edge, Schedule, order

Carry = TypeVar("Carry")
Block = Float[Array, "_ _"]
# What a step reads and writes: an array, or, of few blocks, each by itself.
Blocks = Float[Array, "_ _ _"] | tuple[Block, ...]

_WRITTEN_OUT = 4  # steps


class Factor(eqx.Module):
    """The factors of a matrix A with blocks on the diagonal and at the edges of a graph.

    What is factored is P A Pᵀ = L Δ Lᵀ, with the permutation P of a schedule, L of unit blocks on
    its diagonal and Δ block-diagonal. Step i has the pivot Δ_i = A_ii and the row
    (Lᵀ)_ij = A_ii⁻¹ A_ij; it subtracts A_ji A_ii⁻¹ A_ik from the blocks of its neighbours j and k.
    Pivots are inverted, not factored again: they are small, and products with an inverse are fused
    where triangular solves are not.

    One step follows the other, in a loop. Cyclic reduction would eliminate at once what are no
    neighbours, in fewer steps, but it fills a chain up: on a CPU it takes half as long again to
    run, and three to five times as long to compile.

    **Arguments:**

    - `diagonal`: the blocks A_ii, symmetric; `couplings`: the blocks A_ij of the `edges`, i < j.
    """

    inverses: Float[Array, "steps b b"]  # Δ_i⁻¹
    rows: Float[Array, "steps degree b b"]  # Δ_i⁻¹ A_ij
    edges: tuple[Edge, ...] = eqx.field(static=True)

    def __init__(
        self,
        diagonal: Float[Array, "nodes b b"],
        couplings: Float[Array, "edges b b"],
        edges: tuple[Edge, ...],
    ):
        self.edges = edges
        schedule = order(len(diagonal), edges)
        degree = schedule.neighbours.shape[1]

        def step(carry: tuple[Blocks, Blocks], at: Any) -> tuple[tuple[Blocks, Blocks], Any]:
            (diagonal, couplings), (i, now) = carry, at
            inverse = invert(_read(diagonal, i))
            own = [_read(couplings, now.couplings[p]) for p in range(degree)]
            rows = [multiply(inverse, one) for one in own]
            for p in range(degree):
                change = multiply_transposed(own[p], rows[p])
                diagonal = _subtract(diagonal, now.neighbours[p], change)
            for pair, (p, q) in enumerate(schedule.pairs):
                change = multiply_transposed(own[p], rows[q])
                couplings = _subtract(couplings, now.fill[pair], change)
            stacked = jnp.stack(rows) if rows else jnp.zeros((0, *inverse.shape), inverse.dtype)
            return (diagonal, couplings), (inverse, stacked)

        nodes = np.array(schedule.nodes)
        start = (
            _blocks(take(diagonal, nodes), schedule),
            _blocks(_oriented(couplings, edges, schedule), schedule),
        )
        _, (self.inverses, self.rows) = _each(step, start, schedule)

    def pivots(self) -> Float[Array, " rows"]:
        """What elimination leaves of each diagonal element, given all others of its block."""
        diagonal: Float[Array, " rows"] = (
            1 / jnp.diagonal(self.inverses, axis1=-2, axis2=-1).ravel()
        )
        return diagonal

    def solve(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution x of A x = `right`: L y = right from the first step to the last, then
        Lᵀ x = Δ⁻¹ y from the last to the first.
        """
        schedule = order(len(right), self.edges)
        degree = schedule.neighbours.shape[1]

        def forward(right: Blocks, at: Any) -> tuple[Blocks, Block]:
            i, now, rows = at
            own = _read(right, i)
            for p in range(degree):
                right = _subtract(right, now.neighbours[p], multiply_transposed(rows[p], own))
            return right, own

        def backward(x: Blocks, at: Any) -> tuple[Blocks, Block]:
            i, now, inverse, rows, own = at
            value = multiply(inverse, own)
            for p in range(degree):
                value -= multiply(rows[p], _read(x, now.neighbours[p]))
            return _write(x, i, value), value

        start = _blocks(take(right, np.array(schedule.nodes)), schedule)
        _, own = _each(forward, start, schedule, self.rows)
        nothing, factors = jax.tree.map(jnp.zeros_like, start), (self.inverses, self.rows)
        _, x = _each(backward, nothing, schedule, *factors, own, reverse=True)
        return take(x, np.argsort(schedule.nodes))


def _each(
    step: Callable[[Carry, Any], tuple[Carry, Any]],
    start: Carry,
    schedule: Schedule,
    *xs: Array,
    reverse: bool = False,
) -> tuple[Carry, Any]:
    """All steps of a schedule, each given its number, its tables and its part of `xs`."""
    count = len(schedule.nodes)
    tables = schedule._replace(nodes=(), edges=())
    each = (np.arange(count, dtype=np.uint32), tables, *xs)
    if count > _WRITTEN_OUT:
        return jax.lax.scan(step, start, each, reverse=reverse)
    carry, results = start, [None] * count
    for i in reversed(range(count)) if reverse else range(count):
        carry, results[i] = step(carry, jax.tree.map(lambda x, i=i: x[i], each))
    return carry, jax.tree.map(lambda *own: jnp.stack(own), *results)


def _oriented(
    couplings: Float[Array, "edges b b"], edges: tuple[Edge, ...], schedule: Schedule
) -> Float[Array, "filled b b"]:
    """The blocks of all edges of a schedule, from its earlier to its later step; zero for fill."""
    both = jnp.concatenate([couplings, jnp.swapaxes(couplings, 1, 2)])
    number = {edge: at for at, edge in enumerate(edges)}
    number |= {(j, i): len(edges) + at for at, (i, j) in enumerate(edges)}
    nodes = schedule.nodes
    table = [number.get((nodes[i], nodes[j]), len(both)) for i, j in schedule.edges]
    return take(both, np.array(table, np.uint32))


def _blocks(x: Float[Array, "_ _ _"], schedule: Schedule) -> Blocks:
    """With one block more, for what is not there: it is zero, and stays so."""
    more = jnp.concatenate([x, jnp.zeros((1, *x.shape[1:]), x.dtype)])
    return tuple(more) if len(schedule.nodes) <= _WRITTEN_OUT else more


def _read(x: Blocks, i: Any) -> Block:
    if isinstance(x, tuple):
        return x[int(i)]
    block: Block = jax.lax.dynamic_index_in_dim(x, i, keepdims=False)
    return block


def _write(x: Blocks, i: Any, block: Block) -> Blocks:
    if isinstance(x, tuple):
        return (*x[: int(i)], block, *x[int(i) + 1 :])
    written: Blocks = jax.lax.dynamic_update_index_in_dim(x, block, i, 0)
    return written


def _subtract(x: Blocks, i: Any, change: Block) -> Blocks:
    return _write(x, i, _read(x, i) - change)
