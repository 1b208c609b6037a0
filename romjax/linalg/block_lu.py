"""Factors of a sparse matrix of small blocks that need not be symmetric, in linear time."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import invert_any, multiply
from .fronts import Block, Blocks, add, each, empty, oriented, read, stacked, write
from .indexing import take
from .ordering import Edge, order


class BlockLU(eqx.Module):
    """The factors of a matrix A with blocks on the diagonal and, both ways, at edges of a graph.

    As `Factor` of `block_cholesky`, where A is not symmetric: step i has the pivot Δ_i = A_ii, the
    row Δ_i⁻¹ A_ij and the column A_ji; it subtracts A_ji Δ_i⁻¹ A_ik from the block of its
    neighbours j and k. Rows are exchanged within a pivot only, so each has to be regular: nodes
    whose own block is not come `after` others.

    **Arguments:**

    - `diagonal`: the blocks A_ii; `couplings`: A_ij and A_ji of the `edges`, i < j.
    - `after`: pairs of nodes, of which the first is eliminated after the second.
    """

    inverses: Float[Array, "steps b b"]  # Δ_i⁻¹
    rows: Float[Array, "steps degree b b"]  # Δ_i⁻¹ A_ij
    columns: Float[Array, "steps degree b b"]  # A_ji
    edges: tuple[Edge, ...] = eqx.field(static=True)
    after: tuple[Edge, ...] = eqx.field(static=True)

    def __init__(
        self,
        diagonal: Float[Array, "nodes b b"],
        couplings: Float[Array, "edges 2 b b"],
        edges: tuple[Edge, ...],
        after: tuple[Edge, ...] = (),
    ):
        self.edges, self.after = edges, after
        schedule = order(len(diagonal), edges, after)
        shape, degree = diagonal.shape[1:], schedule.degree

        def step(fronts: tuple[Blocks, Blocks], at: Any) -> tuple[tuple[Blocks, Blocks], Any]:
            (nodes, between), (node, edge, own, couplings) = fronts, at
            inverse = invert_any(own - read(nodes, node.own))
            coupled = [couplings[p] - read(between, edge.own[p]) for p in range(degree)]
            # As for Cholesky's, but A_ji is no transpose of A_ij, so that both go along.
            rows = [multiply(inverse, one[0]) for one in coupled]
            for p in range(degree):
                nodes = add(nodes, node, p, multiply(coupled[p][1], rows[p]))
            for pair, (p, q) in enumerate(schedule.pairs):
                both = [multiply(coupled[p][1], rows[q]), multiply(coupled[q][1], rows[p])]
                between = add(between, edge, pair, jnp.stack(both))
            columns = stacked([one[1] for one in coupled], inverse)
            return (nodes, between), (inverse, stacked(rows, inverse), columns)

        node_slots, edge_slots = schedule.slots
        fronts = (
            empty(node_slots, shape, diagonal.dtype, schedule),
            empty(edge_slots, (2, *shape), diagonal.dtype, schedule),
        )
        _, (self.inverses, self.rows, self.columns) = each(
            step,
            fronts,
            schedule.node_front,
            schedule.edge_front,
            take(diagonal, np.array(schedule.nodes)),
            oriented(jnp.concatenate([couplings, couplings[:, ::-1]]), edges, schedule),
        )

    def solve(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution x of A x = `right`."""
        return self._solve(self.inverses, self.rows, self.columns, right)

    def solve_transposed(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution x of Aᵀ x = `right`: the rows of Aᵀ are the columns of A."""
        inverses, columns = (jnp.swapaxes(x, -1, -2) for x in (self.inverses, self.columns))
        # The factors of Aᵀ = (L U)ᵀ are those of A in the other order.
        before = multiply(inverses[:, None], columns)
        # A_ij = Δ_i times a row.
        after = jnp.swapaxes(self.rows, -1, -2)
        return self._solve(inverses, before, after, right, scaled=True)

    def _solve(
        self,
        inverses: Float[Array, "steps b b"],
        rows: Float[Array, "steps degree b b"],
        columns: Float[Array, "steps degree b b"],
        right: Float[Array, "nodes b k"],
        scaled: bool = False,
    ) -> Float[Array, "nodes b k"]:
        """Solve forwards, where y_j loses A_ji Δ_i⁻¹ y_i; then backwards, from the last to the
        first, x_i = Δ_i⁻¹ y_i − Δ_i⁻¹ A_ij x_j. `scaled`: the columns are A_ji Δ_i⁻¹.
        """
        schedule = order(len(right), self.edges, self.after)
        front, degree = schedule.node_front, schedule.degree

        def forward(parts: Blocks, at: Any) -> tuple[Blocks, Block]:
            node, right, inverse, columns = at
            own = right - read(parts, node.own)
            value = multiply(inverse, own)
            for p in range(degree):
                parts = add(parts, node, p, multiply(columns[p], own if scaled else value))
            return parts, value

        def backward(x: Blocks, at: Any) -> tuple[Blocks, Block]:
            node, rows, value = at
            for p in range(degree):
                value -= multiply(rows[p], read(x, node.onto[p]))
            return write(x, node.own, value), value

        start = empty(schedule.slots[0], right.shape[1:], right.dtype, schedule)
        own = take(right, np.array(schedule.nodes))
        _, own = each(forward, start, front, own, inverses, columns)
        # Where a node gathers what earlier steps give to it, these find it on the way back.
        _, x = each(backward, start, front, rows, own, reverse=True)
        return take(x, np.argsort(schedule.nodes))
