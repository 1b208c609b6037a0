"""Grouping: elements of equal structure are stacked and mapped over at once."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np
from jaxtyping import Array, Float, Shaped

from ..scene.marker import Marker

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class Index:
    """A static table of places in a flat vector: one row per element.

    Hashable, so that it can be part of a program's structure. Places that follow each other are
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
        # Unsigned, so that JAX spares itself the arithmetic of negative places.
        return np.array(self.rows, dtype=np.uint32).reshape(len(self.rows), self.width)

    def take(self, array: Shaped[Array, "n *k"]) -> Shaped[Array, "count size *k"]:
        """The entries of `array` at these places; see `take`."""
        return take(array, self.array)


def take(array: Shaped[Array, "n *k"], table: np.ndarray) -> Shaped[Array, "..."]:
    """The entries along the first axis of `array` at a static table of places; n means a zero."""
    flat, size = table.reshape(-1), array.shape[0]
    start = int(flat[0]) if flat.size else 0
    if start + flat.size <= size and np.array_equal(flat, np.arange(start, start + flat.size)):
        picked = array[start : start + flat.size]
    else:
        if flat.size and flat.max() >= size:
            array = jnp.concatenate([array, np.zeros((1, *array.shape[1:]), array.dtype)])
        picked = array[flat]
    return picked.reshape(table.shape + array.shape[1:])


def stack(elements: Sequence[T]) -> T:
    """One element whose leaves have a new first axis that runs over `elements`.

    Known numbers are stacked by NumPy: a long chain then adds nothing to a traced program.
    """

    def join(*leaves: Any) -> Array:
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return jnp.stack([jnp.asarray(leaf) for leaf in leaves])
        return jnp.asarray(np.stack([np.asarray(leaf) for leaf in leaves]))

    return jtu.tree_map(join, *elements)


def group(elements: Sequence[T]) -> list[tuple[T, list[int]]]:
    """Stacks of the elements of equal structure, each with the places of its elements.

    Equal: the same classes, static fields and shapes. Names do not count.
    """
    found: dict[Any, tuple[list[T], list[int]]] = {}
    for place, element in enumerate(elements):
        plain = anonymous(element)
        leaves, structure = jtu.tree_flatten(plain)
        key = (structure, tuple((jnp.shape(x), jnp.result_type(x)) for x in leaves))
        members, places = found.setdefault(key, ([], []))
        members.append(plain)
        places.append(place)
    return [(stack(members), places) for members, places in found.values()]


def anonymous(element: T) -> T:
    """The element without its name and those of the bodies that its markers sit on."""
    blank = jtu.tree_map(
        lambda x: Marker("", x.point, x.angle) if isinstance(x, Marker) else x,
        element,
        is_leaf=lambda x: isinstance(x, Marker),
    )
    if hasattr(blank, "name"):
        blank = _rename(blank, "")
    return blank


def _rename(element: Any, name: str) -> Any:
    # A copy with another static name, without passing through the checks of its constructor.
    children, structure = jtu.tree_flatten(element, is_leaf=lambda x: x is not element)
    copy = jtu.tree_unflatten(structure, children)
    object.__setattr__(copy, "name", name)
    return copy


def spread(
    blocks: list[Float[Array, "..."]], places: list[np.ndarray], shape: tuple[int, ...]
) -> Float[Array, "..."]:
    """An array with the entries of `blocks` at flat `places` (−1: nowhere), zero elsewhere.

    A gather with a static index: XLA's CPU scatter runs entry by entry.
    """
    entries = jnp.concatenate([block.reshape(-1) for block in blocks])
    place = np.concatenate([p.reshape(-1) for p in places]).astype(int)
    if np.array_equal(place, np.arange(np.prod(shape))):
        return entries.reshape(shape)
    source = np.full(int(np.prod(shape)), entries.size, dtype=np.uint32)
    source[place[place >= 0]] = np.flatnonzero(place >= 0)
    padded = jnp.concatenate([entries, np.zeros(1, entries.dtype)])
    return padded[source].reshape(shape)
