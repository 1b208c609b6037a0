"""The order in which the nodes of a graph are eliminated, as static tables."""

import functools
import heapq
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, UInt32

Edge = tuple[int, int]


class Front(NamedTuple):
    """The slots in which updates of nodes, or of edges, are gathered until their own step.

    Slots are used again: a chain needs one. The last one is for what is not there.
    """

    own: UInt32[np.ndarray, "steps *count"]  # what a step takes
    onto: UInt32[np.ndarray, "steps targets"]  # what it adds to
    first: Bool[np.ndarray, "steps targets"]  # whether nothing has been added to it before


class Schedule(NamedTuple):
    """The order in which nodes are eliminated: a step for each node.

    Nodes are numbered by their steps, so that all neighbours that a node still has come later.
    """

    nodes: tuple[int, ...]  # that the steps eliminate
    later: tuple[tuple[int, ...], ...]  # the neighbours of each step
    node_front: Front  # a step takes its node, and adds to its neighbours
    edge_front: Front  # a step takes its edges, and adds to those between its neighbours
    slots: tuple[int, int]  # of both fronts
    degree: int  # the most neighbours that a node has when it is eliminated

    @property
    def pairs(self) -> tuple[Edge, ...]:
        """All pairs of neighbours by their positions, the first before the second."""
        return _pairs(self.degree)


@functools.lru_cache(maxsize=64)
def order(nodes: int, edges: tuple[Edge, ...], after: tuple[Edge, ...] = ()) -> Schedule:
    """The schedule of a graph: nodes of least degree first, and of these the first.

    Eliminating a node couples all its neighbours with each other. A chain or a tree gains no edge:
    there is always a node with one neighbour at most. Of a pair of `after`, the first node comes
    after the second, since its pivot is singular before.
    """
    missing: dict[int, set[int]] = {i: set() for i in range(nodes)}
    for i, j in after:
        missing[i].add(j)
    neighbours: dict[int, set[int]] = {i: set() for i in range(nodes)}
    for i, j in edges:
        neighbours[i].add(j)
        neighbours[j].add(i)
    sequence, adjacent = list[int](), list[set[int]]()
    # Minimum degree, from a heap whose entries of changed degree are passed over: chains and trees
    # then fill in nothing.
    waiting = [(len(own), i) for i, own in neighbours.items() if not missing[i]]
    heapq.heapify(waiting)
    while waiting:
        degree, i = heapq.heappop(waiting)
        if i not in neighbours or degree != len(neighbours[i]):
            continue  # it is gone, or has other neighbours by now
        own = neighbours.pop(i)
        # Eliminating a node couples all its neighbours.
        for j in own:
            neighbours[j] |= own
            neighbours[j] -= {i, j}
        freed = {k for k, before in missing.items() if i in before}
        for k in freed:
            missing[k].remove(i)
        for j in sorted(own | freed):
            if not missing[j]:
                heapq.heappush(waiting, (len(neighbours[j]), j))
        sequence.append(i)
        adjacent.append(own)
    step = {node: at for at, node in enumerate(sequence)}
    later = [sorted(step[j] for j in own) for own in adjacent]
    degree = max(map(len, later), default=0)
    own_edges = [[(i, j) for j in own] for i, own in enumerate(later)]
    between = [
        [(own[p], own[q]) if q < len(own) else None for p, q in _pairs(degree)] for own in later
    ]
    padded = [[(j, j) for j in own] + [None] * (degree - len(own)) for own in later]
    node_front, node_slots = _front([[(i, i)] for i in range(nodes)], padded, 1)
    edge_front, edge_slots = _front(own_edges, between, degree)
    return Schedule(
        tuple(sequence),
        tuple(map(tuple, later)),
        node_front._replace(own=node_front.own[:, 0]),
        edge_front,
        (node_slots, edge_slots),
        degree,
    )


def _pairs(degree: int) -> tuple[Edge, ...]:
    return tuple((p, q) for q in range(degree) for p in range(q))


def _front(
    taken: Sequence[Sequence[Edge]], given: Sequence[Sequence[Edge | None]], width: int
) -> tuple[Front, int]:
    """The slots of what each step takes, at most `width`, and of what it gives to, and how many
    there are; a node is an edge from itself to itself.
    """
    # A slot holds a block from the first addition to it until its own step takes it; then it is
    # given to another one.
    slots, free, size = dict[Edge, int](), list[int](), 0
    # −1 is padding, for nodes with fewer neighbours than the most.
    own = np.full((len(taken), width), -1)
    onto = np.full((len(given), max(map(len, given), default=0)), -1)
    first = np.zeros(onto.shape, bool)
    for i, (takes, gives) in enumerate(zip(taken, given, strict=True)):
        for p, target in enumerate(takes):
            if target in slots:
                own[i, p] = slots.pop(target)
                free.append(int(own[i, p]))
        for p, receiver in enumerate(gives):
            if receiver is None:
                continue
            if receiver not in slots:
                first[i, p] = True
                if not free:
                    free.append(size)
                    size += 1
                slots[receiver] = free.pop()
            onto[i, p] = slots[receiver]
    # One more slot, the last, takes what is padding.
    table, targets = (np.where(x < 0, size, x).astype(np.uint32) for x in (own, onto))
    return Front(table, targets, first), size + 1
