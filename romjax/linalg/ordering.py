"""The order in which the nodes of a graph are eliminated, as static tables."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt32

Edge = tuple[int, int]


class Schedule(NamedTuple):
    """In what order nodes are eliminated: a step for each node.

    Nodes are numbered by their steps, so that all neighbours that a node still has come later. A
    number one past the end stands for one that is not there.
    """

    neighbours: UInt32[np.ndarray, "steps degree"]  # of the node, in order
    couplings: UInt32[np.ndarray, "steps degree"]  # the edges to them
    fill: UInt32[np.ndarray, "steps pairs"]  # the edges between them, in the order of `pairs`
    nodes: tuple[int, ...]  # that the steps eliminate
    edges: tuple[Edge, ...]  # from the earlier to the later step, with fill

    @property
    def pairs(self) -> tuple[Edge, ...]:
        """All pairs of neighbours, the first before the second."""
        degree = self.neighbours.shape[1]
        return tuple((p, q) for q in range(degree) for p in range(q))


@functools.lru_cache(maxsize=64)
def order(nodes: int, edges: tuple[Edge, ...]) -> Schedule:
    """The schedule of a graph: nodes of least degree first.

    Eliminating a node couples all its neighbours with each other. A chain or a tree gains no edge:
    there is always a node with one neighbour at most.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in range(nodes)}
    for i, j in edges:
        neighbours[i].add(j)
        neighbours[j].add(i)
    sequence, adjacent = list[int](), list[set[int]]()
    while neighbours:
        i = min(neighbours, key=lambda i: (len(neighbours[i]), i))
        own = neighbours.pop(i)
        for j in own:
            neighbours[j] |= own
            neighbours[j] -= {i, j}
        sequence.append(i)
        adjacent.append(own)
    step = {node: at for at, node in enumerate(sequence)}
    later = [sorted(step[j] for j in own) for own in adjacent]
    filled = [(i, j) for i, own in enumerate(later) for j in own]
    number = {edge: at for at, edge in enumerate(filled)}
    degree = max(map(len, later), default=0)
    none = len(filled)

    def between(i: int, j: int) -> int:
        return number.get((i, j), none)

    table = np.array([own + [nodes] * (degree - len(own)) for own in later], np.uint32)
    table = table.reshape(nodes, degree)
    schedule = Schedule(table, table, table, tuple(sequence), tuple(filled))
    couplings = [[between(i, int(j)) for j in own] for i, own in enumerate(table)]
    fill = [[between(int(own[p]), int(own[q])) for p, q in schedule.pairs] for own in table]
    return schedule._replace(
        couplings=np.array(couplings, np.uint32).reshape(nodes, degree),
        fill=np.array(fill, np.uint32).reshape(nodes, len(schedule.pairs)),
    )
