"""Coordinates and constraints that are eliminated at once, as static tables."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt32

from .ordering import Edge
from .pattern import Pattern

# Share by which merged blocks may exceed the widest one: a block less saves a step.
_SLACK = 0.1


class Supernodes(NamedTuple):
    """The unknowns of a KKT system in blocks of one size, and how these hang together.

    The unknowns are the n coordinates, then the m multipliers. A body is a block together with the
    constraints that hold it to what its tree has reached before: such a block is regular by itself.
    Constraints that close a loop are a block of their own, which is regular once all bodies of the
    loop are eliminated. Small blocks join a neighbour, as far as it stays about as wide as others.
    """

    unknowns: UInt32[np.ndarray, "count b"]  # n + m: none
    places: Int[np.ndarray, " unknowns"]  # of each unknown among those
    edges: tuple[Edge, ...]
    after: tuple[Edge, ...]  # the first of each pair is eliminated after the second


@functools.lru_cache(maxsize=64)
def supernodes(pattern: Pattern, pairs: tuple[Edge, ...]) -> Supernodes:
    """The blocks of a pattern whose bodies are coupled in `pairs` too."""
    linked = [
        sorted(int(pattern.bodies[k]) for k in sides if k < len(pattern.nodes))
        for sides in pattern.sides_of_nodes
    ]
    coordinates = [[i for i in own if i < pattern.n] for own in pattern.coordinates.rows]
    rows = [[pattern.n + i for i in own if i < pattern.m] for own in pattern.rows.rows]
    owners, ancestors = _spanning_tree(linked, list(map(len, rows)), len(coordinates))
    blocks, home, closing = list(coordinates), dict[int, int](), list[set[int]]()
    for node, bodies in enumerate(linked):
        # A joint of the spanning tree makes the block of the body that it holds regular; any other
        # closes a loop, and waits for all bodies of it.
        loop = {owners[node]} if node in owners else _loop(bodies, ancestors)
        if len(loop) == 1:
            home[node] = loop.pop()
            blocks[home[node]] = blocks[home[node]] + rows[node]
        else:
            home[node] = len(blocks)
            blocks.append(rows[node])
            closing.append(loop)
    coupled = {(home[node], body) for node, bodies in enumerate(linked) for body in bodies}
    edges = {(min(edge), max(edge)) for edge in (*coupled, *pairs) if edge[0] != edge[1]}
    after = {(len(coordinates) + k, body) for k, loop in enumerate(closing) for body in loop}
    return _merged(blocks, len(coordinates), edges, after, pattern.n + pattern.m)


def _spanning_tree(
    linked: list[list[int]], heights: list[int], count: int
) -> tuple[dict[int, int], list[set[int]]]:
    """The body that each constraint node of a spanning tree holds; and each body's ancestors in it,
    with itself.
    """
    owners, ancestors = dict[int, int](), dict[int, set[int]]()
    while len(ancestors) < count:
        ready = [
            (-heights[node], node, new[0])
            for node, bodies in enumerate(linked)
            if len(new := [body for body in bodies if body not in ancestors]) == 1
        ]
        if not ready:
            body = min(set(range(count)) - set(ancestors))
            ancestors[body] = {body}  # it is free
            continue
        _, node, body = min(ready)
        # The node with the most rows is taken first, and of equals the first one, so that the same
        # mechanism has the same blocks.
        owners[node] = body
        ancestors[body] = {body}.union(*(ancestors[o] for o in linked[node] if o != body))
    return owners, [ancestors[body] for body in range(count)]


def _loop(bodies: list[int], ancestors: list[set[int]]) -> set[int]:
    """The bodies whose motion against the others lets a constraint of some bodies be regular."""
    own = [ancestors[body] for body in bodies]
    # Those that both sides share move them alike. Of more sides than two it is not known.
    return own[0] ^ own[1] if len(own) == 2 else set[int]().union(*own)


def _merged(
    blocks: list[list[int]],
    bodies: int,
    edges: set[Edge],
    after: set[Edge],
    size: int,
) -> Supernodes:
    """Small blocks of bodies joined with neighbours; the rest in the order that is left."""
    into = list(range(len(blocks)))
    widest = max(map(len, blocks))
    limit = widest + int(_SLACK * widest)
    for block in sorted(range(bodies), key=lambda i: (len(blocks[i]), i)):
        # Blocks that are neighbours by now, after those that were merged before.
        around = {into[o] for edge in edges for i, o in (edge, edge[::-1]) if into[i] == block}
        near = [(len(blocks[o]), o) for o in around - {block} if o < bodies]
        if near and len(blocks[block]) + min(near)[0] <= limit:
            other = min(near)[1]
            blocks[other], blocks[block] = blocks[other] + blocks[block], []
            into = [other if o == block else o for o in into]
    kept = [i for i, own in enumerate(blocks) if own]
    number = {block: at for at, block in enumerate(kept)}
    width = max(map(len, blocks))
    unknowns = np.array([blocks[i] + [size] * (width - len(blocks[i])) for i in kept], np.uint32)
    ends = [(number[into[i]], number[into[j]]) for i, j in edges]
    own = {(min(edge), max(edge)) for edge in ends if edge[0] != edge[1]}
    late = {(number[into[i]], number[into[j]]) for i, j in after}
    places = np.argsort(unknowns.reshape(-1), kind="stable")[:size]
    return Supernodes(unknowns, places, tuple(sorted(own)), tuple(sorted(late)))
