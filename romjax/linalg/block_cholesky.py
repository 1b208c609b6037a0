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
from .ordering import Edge, Front, Schedule, order

Carry = TypeVar("Carry")
Block = Float[Array, "_ _"]
# Slots of a front: an array, or, where steps are written out, each by itself.
Blocks = Float[Array, "_ _ _"] | tuple[Block, ...]

_WRITTEN_OUT = 4  # steps


class Factor(eqx.Module):
    """The factors of a matrix A with blocks on the diagonal and at the edges of a graph.

    What is factored is P A Pᵀ = L Δ Lᵀ, with the permutation P of a schedule, L of unit blocks on
    its diagonal and Δ block-diagonal. Step i has the pivot Δ_i = A_ii and the row
    (Lᵀ)_ij = A_ii⁻¹ A_ij; it subtracts A_ji A_ii⁻¹ A_ik from the blocks of its neighbours j and k.
    Pivots are inverted, not factored again: they are small, and products with an inverse are fused
    where triangular solves are not.

    One step follows the other, in a loop. What it subtracts is gathered in slots that are few: XLA
    copies what a loop reads and writes in each step. Cyclic reduction would eliminate at once what
    are no neighbours, in fewer steps, but it fills a chain up: on a CPU it takes two to four times
    as long to run, and three to five times as long to compile.

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
        shape, degree = diagonal.shape[1:], schedule.degree

        def step(fronts: tuple[Blocks, Blocks], at: Any) -> tuple[tuple[Blocks, Blocks], Any]:
            (nodes, between), (node, edge, own, couplings) = fronts, at
            inverse = invert(own - _read(nodes, node.own))
            coupled = [couplings[p] - _read(between, edge.own[p]) for p in range(degree)]
            rows = [multiply(inverse, one) for one in coupled]
            for p in range(degree):
                nodes = _add(nodes, node, p, multiply_transposed(coupled[p], rows[p]))
            for pair, (p, q) in enumerate(schedule.pairs):
                between = _add(between, edge, pair, multiply_transposed(coupled[p], rows[q]))
            return (nodes, between), (inverse, _stacked(rows, inverse))

        node_slots, edge_slots = (
            _empty(slots, shape, diagonal.dtype, schedule) for slots in schedule.slots
        )
        _, (self.inverses, self.rows) = _each(
            step,
            (node_slots, edge_slots),
            schedule.node_front,
            schedule.edge_front,
            take(diagonal, np.array(schedule.nodes)),
            _oriented(couplings, edges, schedule),
        )

    def pivots(self) -> Float[Array, " rows"]:
        """Return what elimination leaves of each diagonal element, given the rest of its block."""
        diagonal: Float[Array, " rows"] = (
            1 / jnp.diagonal(self.inverses, axis1=-2, axis2=-1).ravel()
        )
        return diagonal

    def solve(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution x of A x = `right`: L y = right from the first step to the last, then
        Lᵀ x = Δ⁻¹ y from the last to the first.
        """
        schedule = order(len(right), self.edges)
        front, degree = schedule.node_front, schedule.degree

        def forward(parts: Blocks, at: Any) -> tuple[Blocks, Block]:
            node, right, rows = at
            own = right - _read(parts, node.own)
            for p in range(degree):
                parts = _add(parts, node, p, multiply_transposed(rows[p], own))
            return parts, own

        def backward(x: Blocks, at: Any) -> tuple[Blocks, Block]:
            node, inverse, rows, own = at
            value = multiply(inverse, own)
            for p in range(degree):
                value -= multiply(rows[p], _read(x, node.onto[p]))
            return _write(x, node.own, value), value

        start = _empty(schedule.slots[0], right.shape[1:], right.dtype, schedule)
        own = take(right, np.array(schedule.nodes))
        _, own = _each(forward, start, front, own, self.rows)
        # Where a node gathers what earlier steps give to it, these find it on the way back.
        _, x = _each(backward, start, front, self.inverses, self.rows, own, reverse=True)
        return take(x, np.argsort(schedule.nodes))


def _each(
    step: Callable[[Carry, Any], tuple[Carry, Any]], start: Carry, *xs: Any, reverse: bool = False
) -> tuple[Carry, Any]:
    """All steps of a schedule, each given its part of `xs`."""
    count = len(jax.tree.leaves(xs)[0])
    if count > _WRITTEN_OUT:
        return jax.lax.scan(step, start, xs, reverse=reverse)
    carry, results = start, [None] * count
    for i in reversed(range(count)) if reverse else range(count):
        carry, results[i] = step(carry, jax.tree.map(lambda x, i=i: x[i], xs))
    return carry, jax.tree.map(lambda *own: jnp.stack(own), *results)


def _oriented(
    couplings: Float[Array, "edges b b"], edges: tuple[Edge, ...], schedule: Schedule
) -> Float[Array, "steps degree b b"]:
    """The blocks of the edges of each step to later ones; zero where there is none, or fill."""
    both = jnp.concatenate([couplings, jnp.swapaxes(couplings, 1, 2)])
    number = {edge: at for at, edge in enumerate(edges)}
    number |= {(j, i): len(edges) + at for at, (i, j) in enumerate(edges)}
    nodes, none = schedule.nodes, len(both)
    table = np.full((len(nodes), schedule.degree), none, np.uint32)
    for i, row, own in zip(nodes, table, schedule.later, strict=True):
        row[: len(own)] = [number.get((i, nodes[j]), none) for j in own]
    return take(both, table)


def _stacked(blocks: list[Block], like: Block) -> Float[Array, "_ _ _"]:
    return jnp.stack(blocks) if blocks else jnp.zeros((0, *like.shape), like.dtype)


def _empty(slots: int, shape: tuple[int, ...], dtype: Any, schedule: Schedule) -> Blocks:
    """The slots of a front before the first step."""
    zeros = jnp.zeros((slots, *shape), dtype)
    return tuple(zeros) if len(schedule.nodes) <= _WRITTEN_OUT else zeros


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


def _add(x: Blocks, front: Front, p: int, change: Block) -> Blocks:
    """Add a change to the slot of target p of a step, or store it there where it is the first."""
    i, first = front.onto[p], front.first[p]
    if isinstance(x, tuple):
        return _write(x, i, change if first else _read(x, i) + change)
    return _write(x, i, jnp.where(first, change, _read(x, i) + change))
