"""The steps of an elimination, in a loop or written out, and the slots that hand blocks on."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .indexing import take
from .ordering import Edge, Front, Schedule

Carry = TypeVar("Carry")
Block = Float[Array, "..."]
# Slots of a front: an array, or, where steps are written out, each by itself.
Blocks = Float[Array, "_ ..."] | tuple[Block, ...]

_WRITTEN_OUT = 4  # steps


def each(
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


def stacked(blocks: list[Block], like: Block) -> Float[Array, "_ _ _"]:
    return jnp.stack(blocks) if blocks else jnp.zeros((0, *like.shape), like.dtype)


def empty(slots: int, shape: tuple[int, ...], dtype: Any, schedule: Schedule) -> Blocks:
    """The slots of a front before the first step."""
    zeros = jnp.zeros((slots, *shape), dtype)
    return tuple(zeros) if len(schedule.nodes) <= _WRITTEN_OUT else zeros


def read(x: Blocks, i: Any) -> Block:
    if isinstance(x, tuple):
        return x[int(i)]
    block: Block = jax.lax.dynamic_index_in_dim(x, i, keepdims=False)
    return block


def write(x: Blocks, i: Any, block: Block) -> Blocks:
    if isinstance(x, tuple):
        return (*x[: int(i)], block, *x[int(i) + 1 :])
    written: Blocks = jax.lax.dynamic_update_index_in_dim(x, block, i, 0)
    return written


def add(x: Blocks, front: Front, p: int, change: Block) -> Blocks:
    """Add a change to the slot of target p of a step, or store it there where it is the first."""
    i, first = front.onto[p], front.first[p]
    if isinstance(x, tuple):
        return write(x, i, change if first else read(x, i) + change)
    return write(x, i, jnp.where(first, change, read(x, i) + change))


def oriented(
    both: Float[Array, "twice *block"], edges: tuple[Edge, ...], schedule: Schedule
) -> Float[Array, "steps degree *block"]:
    """The blocks of each step and later ones; zero where there is none, or fill.

    `both`: the blocks of all edges (i, j), and after them those of (j, i), which are needed where
    j is eliminated before i.
    """
    number = {edge: at for at, edge in enumerate(edges)}
    number |= {(j, i): len(edges) + at for at, (i, j) in enumerate(edges)}
    nodes, none = schedule.nodes, len(both)
    # One beyond the last is no block; what is taken there is zero.
    table = np.full((len(nodes), schedule.degree), none, np.uint32)
    for i, row, own in zip(nodes, table, schedule.later, strict=True):
        row[: len(own)] = [number.get((i, nodes[j]), none) for j in own]
    return take(both, table)
