"""Grouping: elements of equal structure are stacked and mapped over at once."""

from collections.abc import Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np

from ..common import arrays
from ..common.compat import is_traced
from ..scene.marker import Marker
from ..scene.points import NamedPoints

T = TypeVar("T")


def stack(elements: Sequence[T]) -> T:
    """One element whose leaves have a new first axis that runs over `elements`.

    Numbers that are not traced are stacked by NumPy: a long chain then adds nothing to a traced
    program.
    """
    stacked: T = jtu.tree_map(lambda *leaves: arrays.stack(leaves), *elements)
    return stacked


def member(stacked: T, row: int) -> T:
    """One of the elements that are stacked."""

    def pick(leaf: Any) -> Any:
        # By NumPy where JAX does not trace: a program for each slice would take longer.
        return leaf[row] if is_traced(leaf) else np.asarray(leaf)[row]

    one: T = jtu.tree_map(pick, stacked)
    return one


def group(elements: Sequence[T]) -> list[tuple[T, list[int]]]:
    """Stacks of the elements of equal structure, each with the indices of its elements.

    Equal: the same classes, static fields and shapes. Names do not count.
    """
    groups: dict[Any, tuple[list[T], list[int]]] = {}
    for index, element in enumerate(elements):
        plain = anonymous(element)
        leaves, structure = jtu.tree_flatten(plain)
        key = (structure, tuple((jnp.shape(x), jnp.result_type(x)) for x in leaves))
        members, indices = groups.setdefault(key, ([], []))
        members.append(plain)
        indices.append(index)
    return [(stack(members), indices) for members, indices in groups.values()]


def anonymous(element: T) -> T:
    """The element without its name, its named points and the bodies that its markers sit on."""

    def blanked(x: Any) -> Any:
        if isinstance(x, NamedPoints):
            return NamedPoints((), ())
        return Marker("", x.point, x.turn) if isinstance(x, Marker) else x

    blank: T = jtu.tree_map(blanked, element, is_leaf=lambda x: isinstance(x, Marker | NamedPoints))
    if hasattr(blank, "name"):
        blank = with_name(blank, "")
    return blank


def points_of(body: Any) -> NamedPoints:
    """The named points of a body, of one within another too; none of a body without any."""
    leaves = jtu.tree_leaves(body, is_leaf=_is_points)
    return next((leaf for leaf in leaves if _is_points(leaf)), NamedPoints((), ()))


def with_points(body: T, points: NamedPoints) -> T:
    """A copy of a body with other named points."""
    copy: T = jtu.tree_map(lambda x: points if _is_points(x) else x, body, is_leaf=_is_points)
    return copy


def _is_points(x: Any) -> bool:
    return isinstance(x, NamedPoints)


def with_name(element: T, name: str) -> T:
    """A copy with another static name, without passing through the checks of its constructor."""
    children, structure = jtu.tree_flatten(element, is_leaf=lambda x: x is not element)
    copy: T = jtu.tree_unflatten(structure, children)
    object.__setattr__(copy, "name", name)
    return copy
