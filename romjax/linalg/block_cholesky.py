"""Factors of a sparse symmetric positive definite matrix of small blocks, in linear time."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import invert, multiply, multiply_transposed
from .fronts import Block, Blocks, add, each, empty, oriented, read, stacked, write
from .indexing import take
from .ordering import Edge, order


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
            # Δ_i = A_ii − what steps before it took from it.
            inverse = invert(own - read(nodes, node.own))
            coupled = [couplings[p] - read(between, edge.own[p]) for p in range(degree)]
            rows = [multiply(inverse, one) for one in coupled]
            for p in range(degree):
                nodes = add(nodes, node, p, multiply_transposed(coupled[p], rows[p]))
            # Neighbours of an eliminated node become neighbours of each other: A_jk loses A_ji
            # Δ_i⁻¹ A_ik.
            for pair, (p, q) in enumerate(schedule.pairs):
                between = add(between, edge, pair, multiply_transposed(coupled[p], rows[q]))
            return (nodes, between), (inverse, stacked(rows, inverse))

        node_slots, edge_slots = (
            empty(slots, shape, diagonal.dtype, schedule) for slots in schedule.slots
        )
        _, (self.inverses, self.rows) = each(
            step,
            (node_slots, edge_slots),
            schedule.node_front,
            schedule.edge_front,
            take(diagonal, np.array(schedule.nodes)),
            oriented(jnp.concatenate([couplings, jnp.swapaxes(couplings, 1, 2)]), edges, schedule),
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
            own = right - read(parts, node.own)
            for p in range(degree):
                parts = add(parts, node, p, multiply_transposed(rows[p], own))
            return parts, own

        def backward(x: Blocks, at: Any) -> tuple[Blocks, Block]:
            node, inverse, rows, own = at
            # x_i = Δ_i⁻¹ y_i − Σ Δ_i⁻¹ A_ij x_j, with the x_j of later steps.
            value = multiply(inverse, own)
            for p in range(degree):
                value -= multiply(rows[p], read(x, node.onto[p]))
            return write(x, node.own, value), value

        start = empty(schedule.slots[0], right.shape[1:], right.dtype, schedule)
        own = take(right, np.array(schedule.nodes))
        _, own = each(forward, start, front, own, self.rows)
        # Where a node gathers what earlier steps give to it, these find it on the way back.
        _, x = each(backward, start, front, self.inverses, self.rows, own, reverse=True)
        return take(x, np.argsort(schedule.nodes))
