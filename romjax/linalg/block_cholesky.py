"""Factors of a sparse symmetric positive definite matrix of small blocks, in linear time."""

import functools
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from .dense import invert, multiply, multiply_transposed

Edge = tuple[int, int]
Pair = tuple[Array, Array]
Carry = TypeVar("Carry")
Levels = TypeVar("Levels")
Out = TypeVar("Out")

_WRITTEN_OUT = 6  # levels: a chain of 32


class Schedule(NamedTuple):
    """In what order nodes are eliminated: one row for each level, all rows of one shape.

    The nodes of a level do not touch each other, so they are eliminated at once. Of a chain each
    level takes every other node; the levels grow with the logarithm of its length. An entry one
    past the end stands for a zero.
    """

    nodes: UInt32[np.ndarray, "levels width"]
    neighbours: UInt32[np.ndarray, "levels width degree"]
    couplings: UInt32[np.ndarray, "levels width degree"]  # with the neighbours; see `Factor`
    onto_nodes: UInt32[np.ndarray, "levels nodes most"]  # which products each node receives
    onto_edges: UInt32[np.ndarray, "levels edges most"]  # and each edge
    onto_sides: UInt32[np.ndarray, "levels nodes most"]  # and each part of a right-hand side
    place: UInt32[np.ndarray, "levels nodes"]  # of a node in its level


@functools.lru_cache(maxsize=64)
def order(nodes: int, edges: tuple[Edge, ...]) -> tuple[Schedule, int]:
    """A schedule for a graph, and its number of edges with fill, the given ones first.

    Each level is an independent set of nodes of least degree, or of degree two at most, so that
    chains and trees gain no more edges than they lose.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in range(nodes)}
    for i, j in edges:
        neighbours[i].add(j)
        neighbours[j].add(i)
    slots = {edge: place for place, edge in enumerate(edges)}
    levels: list[list[tuple[int, list[int]]]] = []
    while neighbours:
        limit = max(2, min(len(near) for near in neighbours.values()))
        level, blocked = [], set[int]()
        for i in sorted(neighbours, key=lambda i: (len(neighbours[i]), i)):
            if i not in blocked and len(neighbours[i]) <= limit:
                level.append((i, sorted(neighbours[i])))
                blocked |= neighbours[i]
        for i, near in level:
            del neighbours[i]
            for j in near:
                neighbours[j] |= set(near)
                neighbours[j] -= {i, j}
                for k in near:
                    if j < k:
                        slots.setdefault((j, k), len(slots))
        levels.append(level)
    return _tables(nodes, slots, levels), len(slots)


def _tables(
    nodes: int, slots: dict[Edge, int], levels: list[list[tuple[int, list[int]]]]
) -> Schedule:
    count, width = len(levels), max(map(len, levels))
    degree = max(len(near) for level in levels for _, near in level)
    places = np.zeros((3, count, width, degree), np.uint32)
    places[2] = 2 * len(slots)
    picked = np.zeros((count, width), np.uint32)
    place = np.full((count, nodes), width, np.uint32)
    products: list[dict[Edge, list[int]]] = [{} for _ in levels]
    sides: list[dict[Edge, list[int]]] = [{} for _ in levels]
    for depth, level in enumerate(levels):
        for a, (i, near) in enumerate(level):
            picked[depth, a], place[depth, i] = i, a
            for p, j in enumerate(near):
                places[1, depth, a, p] = j
                places[2, depth, a, p] = slots[i, j] if i < j else len(slots) + slots[j, i]
                sides[depth].setdefault((j, j), []).append(a * degree + p)
                for q, k in enumerate(near):
                    if j <= k:
                        product = (a * degree + p) * degree + q
                        products[depth].setdefault((j, k), []).append(product)

    def table(found: list[dict[Edge, list[int]]], keys: list[Edge], size: int) -> np.ndarray:
        most = max((len(level.get(key, [])) for level in found for key in keys), default=0)
        filled = np.full((count, len(keys), most), size, np.uint32)
        for depth, level in enumerate(found):
            for a, key in enumerate(keys):
                entries = level.get(key, [])
                filled[depth, a, : len(entries)] = entries
        return filled

    own = [(i, i) for i in range(nodes)]
    return Schedule(
        picked,
        places[1],
        places[2],
        table(products, own, width * degree**2),
        table(products, list(slots), width * degree**2),
        table(sides, own, width * degree),
        place,
    )


class Factor(eqx.Module):
    """The factors of a matrix with blocks on the diagonal and at the edges of a graph.

    Block elimination in the order of a schedule. A level reads the blocks of its couplings from
    the list of all edges (i, j) with i < j, followed by their transposes.
    """

    inverses: Float[Array, "levels width b b"]  # of the pivots
    rows: Float[Array, "levels width degree b b"]  # inverse of the pivot times coupling
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
            inverse, near = invert(diagonal[at.nodes]), _padded(both)[at.couplings]
            rows = multiply(inverse[:, None], near)
            products = multiply_transposed(near[:, :, None], rows[:, None])
            flat = _padded(products.reshape(-1, *shape))
            diagonal -= jnp.sum(flat[at.onto_nodes], axis=1)
            couplings -= jnp.sum(flat[at.onto_edges], axis=1)
            return (diagonal, couplings), (inverse, rows)

        start = (diagonal, jnp.concatenate([couplings, fill]))
        _, (self.inverses, self.rows) = _each(level, start, schedule)

    def solve(self, right: Float[Array, "nodes b k"]) -> Float[Array, "nodes b k"]:
        """The solution for several right-hand sides."""
        schedule, _ = order(self.nodes, self.edges)

        def down(right: Array, xs: tuple[Schedule, Array]) -> Pair:
            at, rows = xs
            own = right[at.nodes]
            passed = multiply_transposed(rows, own[:, None])
            passed = _padded(passed.reshape(-1, *right.shape[1:]))
            return right - jnp.sum(passed[at.onto_sides], axis=1), own

        def up(x: Array, xs: tuple[Schedule, Array, Array, Array]) -> tuple[Array, None]:
            at, inverse, rows, own = xs
            known = jnp.sum(multiply(rows, x[at.neighbours]), axis=1)
            return x + _padded(multiply(inverse, own) - known)[at.place], None

        _, own = _each(down, right, (schedule, self.rows))
        back = (schedule, self.inverses, self.rows, own)
        x, _ = _each(up, jnp.zeros_like(right), back, reverse=True)
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
