"""The order in which the nodes of a graph are eliminated, as static tables."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt32

Edge = tuple[int, int]
# A level of the elimination: its nodes, each with its neighbours at that time.
Level = list[tuple[int, list[int]]]


class Schedule(NamedTuple):
    """In what order nodes are eliminated: one row for each level, all rows of one shape.

    The nodes of a level are not neighbours of each other, so they are eliminated at once. Of a
    chain each level takes every other node (cyclic reduction); the number of levels grows with the
    logarithm of its length. An index one past the end stands for a zero.
    """

    nodes: UInt32[np.ndarray, "levels width"]
    neighbours: UInt32[np.ndarray, "levels width degree"]
    couplings: UInt32[np.ndarray, "levels width degree"]  # with the neighbours; see `Factor`
    onto_nodes: UInt32[np.ndarray, "levels nodes most"]  # which products each node receives
    onto_edges: UInt32[np.ndarray, "levels edges most"]  # and each edge
    onto_sides: UInt32[np.ndarray, "levels nodes most"]  # and each part of a right-hand side
    position: UInt32[np.ndarray, "levels nodes"]  # of a node in its level


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
    edge_index = {edge: index for index, edge in enumerate(edges)}
    levels: list[Level] = []
    while neighbours:
        limit = max(2, min(map(len, neighbours.values())))
        level, blocked = [], set[int]()
        for i in sorted(neighbours, key=lambda i: (len(neighbours[i]), i)):
            if i not in blocked and len(neighbours[i]) <= limit:
                level.append((i, sorted(neighbours[i])))
                blocked |= neighbours[i]
        # Eliminating a node couples its neighbours with each other: where there was no edge, one
        # is filled in.
        for i, adjacent in level:
            del neighbours[i]
            for j in adjacent:
                neighbours[j] |= set(adjacent)
                neighbours[j] -= {i, j}
                for k in adjacent:
                    if j < k:
                        edge_index.setdefault((j, k), len(edge_index))
        levels.append(level)
    return _schedule(nodes, edge_index, levels), len(edge_index)


def _schedule(nodes: int, edge_index: dict[Edge, int], levels: list[Level]) -> Schedule:
    count, width = len(levels), max(map(len, levels))
    degree = max(len(adjacent) for level in levels for _, adjacent in level)
    eliminated = np.zeros((count, width), np.uint32)
    neighbours = np.zeros((count, width, degree), np.uint32)
    couplings = np.full((count, width, degree), 2 * len(edge_index), np.uint32)
    position = np.full((count, nodes), width, np.uint32)
    # Which entries each block receives, level by level: the pair (i, i) stands for a node. Products
    # are numbered by the eliminated node and two of its neighbours, sides by one of them.
    products: list[dict[Edge, list[int]]] = [{} for _ in levels]
    sides: list[dict[Edge, list[int]]] = [{} for _ in levels]
    for depth, level in enumerate(levels):
        for a, (i, adjacent) in enumerate(level):
            eliminated[depth, a], position[depth, i] = i, a
            for p, j in enumerate(adjacent):
                transposed = len(edge_index) if i > j else 0
                neighbours[depth, a, p] = j
                couplings[depth, a, p] = transposed + edge_index[min(i, j), max(i, j)]
                sides[depth].setdefault((j, j), []).append(a * degree + p)
                for q, k in enumerate(adjacent):
                    if j <= k:
                        product = (a * degree + p) * degree + q
                        products[depth].setdefault((j, k), []).append(product)
    diagonal = [(i, i) for i in range(nodes)]
    return Schedule(
        eliminated,
        neighbours,
        couplings,
        _table(products, diagonal, width * degree**2),
        _table(products, list(edge_index), width * degree**2),
        _table(sides, diagonal, width * degree),
        position,
    )


def _table(
    received: list[dict[Edge, list[int]]], blocks: list[Edge], size: int
) -> UInt32[np.ndarray, "levels blocks most"]:
    """What each of the `blocks` receives in each level, filled with `size`."""
    most = max((len(level.get(block, [])) for level in received for block in blocks), default=0)
    table = np.full((len(received), len(blocks), most), size, np.uint32)
    for depth, level in enumerate(received):
        for row, block in enumerate(blocks):
            entries = level.get(block, [])
            table[depth, row, : len(entries)] = entries
    return table
