"""Objects partitioned into arrays and static leaves."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from .compat import is_outermost
from .identity_cache import IdentityCache

_parts = IdentityCache()


class Partitioned(eqx.Module):
    """An object partitioned into arrays and static leaves, to pass through any transformation.

    The numbers of a solver (tolerances of an iteration, say) or of a system may be traced; their
    functions are leaves that `jax.jit` does not accept, and become static.
    """

    # In messages a whole system would fill pages.
    arrays: tuple[Any, ...] = eqx.field(repr=False)
    static: tuple[Any, ...] = eqx.field(static=True, repr=False)  # other leaves; None for an array
    tree: Any = eqx.field(static=True, repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and copied with an example in place of the `tree`: equinox fills absent fields
        with a mark of which there is one in a process, and a tree with a copy of it unflattens to
        nothing.
        """
        example = jax.tree.unflatten(self.tree, range(self.tree.num_leaves))
        return _restored, (self.arrays, self.static, example)

    @classmethod
    def of(cls, whole: Any) -> "Partitioned":
        """Partition an object; the result is remembered with it where JAX does not trace."""
        if not is_outermost():
            return cls.split(whole)
        parts: Partitioned = _parts.get(whole) or _parts.put(whole, cls.split(whole))
        return parts

    @classmethod
    def split(cls, whole: Any) -> "Partitioned":
        """Partition an object that is not asked for again."""
        leaves, tree = jax.tree.flatten(whole)
        arrays = [isinstance(x, jax.Array | np.ndarray) for x in leaves]
        return cls(
            tuple(x for x, is_array in zip(leaves, arrays, strict=True) if is_array),
            tuple(None if is_array else x for x, is_array in zip(leaves, arrays, strict=True)),
            tree,
        )

    def combine(self) -> Any:
        """Return the object that was partitioned."""
        arrays = iter(self.arrays)
        leaves = [next(arrays) if x is None else x for x in self.static]
        return jax.tree.unflatten(self.tree, leaves)


def detached(*objects: Any) -> Any:
    """The objects with `jax.lax.stop_gradient` of their arrays; it takes no functions, as users'
    systems have, and refuses the whole.
    """
    parts = Partitioned.split(objects)
    return Partitioned(jax.lax.stop_gradient(parts.arrays), parts.static, parts.tree).combine()


def _restored(arrays: tuple[Any, ...], static: tuple[Any, ...], example: Any) -> Partitioned:
    return Partitioned(arrays, static, jax.tree.structure(example))
