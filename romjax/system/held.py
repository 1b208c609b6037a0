"""Effects whose law is held on one side of where they begin."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..scene.effect.base import AbstractMarkerEffect


def can_hold(tree: Any) -> tuple[bool, ...]:
    """Whether each effect of a pytree that may begin has a law to be held, in their order."""
    return _of_each(tree, _holds)


def goes_on(tree: Any) -> tuple[bool, ...]:
    """Whether each of them has one that is smooth on both sides."""
    return _of_each(tree, lambda effect: effect.goes_on and _holds(effect))


def oscillates(tree: Any) -> tuple[bool, ...]:
    """Whether each of them may begin and end again and again while bodies just turn."""
    return _of_each(tree, lambda effect: effect.oscillates)


def _of_each(tree: Any, test: Callable[[AbstractMarkerEffect], bool]) -> tuple[bool, ...]:
    found = [x for x in jax.tree.leaves(tree, is_leaf=_begins) if _begins(x)]
    return tuple(np.repeat([test(x) for x in found], [_count(x) for x in found]).tolist())


def hold(tree: Any, sides: Float[Array, " effects"]) -> Any:
    """Return a pytree with its effects that may begin held on their `sides`, which count
    for each copy of these effects again.
    """
    first = 0

    def change(x: Any) -> Any:
        nonlocal first
        if not _begins(x):
            return x
        own = sides[first : first + _count(x)]
        first = (first + _count(x)) % len(sides)
        return jax.vmap(lambda one, side: one.held(side))(x, own) if _holds(x) else x

    return jax.tree.map(change, tree, is_leaf=_begins)


def _begins(x: Any) -> bool:
    return isinstance(x, AbstractMarkerEffect) and x.begins


def _holds(effect: AbstractMarkerEffect) -> bool:
    return effect.held(jnp.zeros(())) is not None


def _count(effect: AbstractMarkerEffect) -> int:
    """How many effects of equal structure are stacked."""
    return len(jax.tree.leaves(effect)[0])
