"""Static tables of indices into flat arrays, and gathers by them."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped


@dataclasses.dataclass(frozen=True)
class Index:
    """A static table of indices into a flat vector: one row per element.

    Hashable, so that it can be part of a program's structure. Consecutive indices are
    sliced, others gathered.
    """

    rows: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, rows: Sequence[Sequence[int]]) -> "Index":
        return cls(tuple(tuple(int(i) for i in row) for row in rows))

    @property
    def width(self) -> int:
        return len(self.rows[0]) if self.rows else 0

    @property
    def array(self) -> np.ndarray:
        # Unsigned, so that JAX spares itself the arithmetic of negative indices.
        return np.array(self.rows, dtype=np.uint32).reshape(len(self.rows), self.width)

    def take(self, array: Shaped[Array, "n *k"]) -> Shaped[Array, "count size *k"]:
        """The entries of `array` at these indices; see `take`."""
        return take(array, self.array)


def take(array: Shaped[Array, "n *k"], table: np.ndarray) -> Shaped[Array, "..."]:
    """The entries along the first axis of `array` at a static table of indices; n means a zero."""
    flat, size = table.reshape(-1), array.shape[0]
    start = int(flat[0]) if flat.size else 0
    if start + flat.size <= size and np.array_equal(flat, np.arange(start, start + flat.size)):
        picked = consecutive(array, start, flat.size)
    else:
        if flat.size and flat.max() >= size:
            array = jnp.concatenate([array, np.zeros((1, *array.shape[1:]), array.dtype)])
        picked = array[flat]
    rows: Array = picked.reshape(table.shape + array.shape[1:])
    return rows


def consecutive(array: Any, start: int, count: int) -> Any:
    """Consecutive entries along the first axis of an array of JAX or NumPy, as a slice, but faster
    to trace.
    """
    if isinstance(array, np.ndarray):
        return array[start : start + count]
    return jax.lax.slice_in_dim(array, start, start + count)


def spread(
    blocks: list[Float[Array, "..."]], indices: list[np.ndarray], shape: tuple[int, ...]
) -> Float[Array, "..."]:
    """An array with the sums of the entries of `blocks` at flat `indices` (−1: nowhere).

    A gather with a static index: XLA's CPU scatter runs entry by entry. One more for entries that
    share a place.
    """
    entries = jnp.concatenate([block.reshape(-1) for block in blocks])
    index = np.concatenate([table.reshape(-1) for table in indices]).astype(int)
    if np.array_equal(index, np.arange(np.prod(shape))):
        return entries.reshape(shape)
    source = np.full(int(np.prod(shape)), entries.size, dtype=np.uint32)
    # Of entries with one place the last one is taken here, and the others by the next call.
    source[index[index >= 0]] = np.flatnonzero(index >= 0)
    padded = jnp.concatenate([entries, np.zeros(1, entries.dtype)])
    index[source[source < entries.size]] = -1
    total = padded[source].reshape(shape)
    return total + spread([entries], [index], shape) if np.any(index >= 0) else total


def sum_onto(blocks: Float[Array, "k ..."], onto: np.ndarray, count: int) -> Float[Array, "..."]:
    """`count` sums of the blocks with the same static number `onto` (k,) (−1: in none)."""
    members = [np.flatnonzero(onto == i) for i in range(count)]
    table = np.full((count, max(map(len, members), default=0)), len(onto), np.uint32)
    for row, own in zip(table, members, strict=True):
        row[: len(own)] = own
    return jnp.sum(take(blocks, table), axis=1)
