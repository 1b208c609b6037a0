"""Types of numbers that users may give, and their conversion to arrays."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np
from jaxtyping import Array, ArrayLike, Real

from .compat import is_outermost, is_traced

T = TypeVar("T")

Number = ArrayLike
# Sequences of sequences, three deep, as lists of matrices are. Not Sequence[Any], nor a type that
# names itself: to checkers a string would be one.
_Row = Sequence[ArrayLike]
_Rows = Sequence[ArrayLike | _Row]
Vector = ArrayLike | Sequence[ArrayLike | _Rows]
Time = Real[ArrayLike, ""]  # [s]
if TYPE_CHECKING:
    # To checkers an array of JAX, since all that functions return for one of its arrays is one.
    Numbers = Array
else:
    Numbers = Array | np.ndarray


def as_array(value: Any) -> Array:
    """`value` as a floating-point array of the precision that JAX is set to."""
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jnp.inexact):
        return value
    dtype = jnp.result_type(float)
    numbers = value if isinstance(value, tuple | list) else (value,)
    if all(isinstance(x, float | int) for x in numbers):
        return as_jax(np.asarray(value, dtype))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        return as_jax(value.astype(dtype, copy=False))
    return jnp.asarray(value, dtype=dtype)


def as_arrays(tree: T) -> T:
    """A pytree with each number as an array.

    Functions in it, such as the activations of a network, become a part of its structure: as leaves
    neither JAX takes them, nor can equal parts be stacked.
    """

    def converted(leaf: Any) -> Any:
        return jtu.Partial(leaf) if callable(leaf) else as_array(leaf)

    changed: T = jtu.tree_map(converted, tree)
    return changed


def as_jax(array: Array | np.ndarray) -> Array:
    """An array of NumPy as one of JAX, of the precision that JAX is set to.

    Where JAX does not trace it is copied: `jnp.asarray` compiles a program for each new shape.
    """
    if isinstance(array, jax.Array) or not is_outermost():
        return jnp.asarray(array)
    # It gets a copy: what JAX is given may share the memory of an array that its owner changes
    # later.
    copied: Array = jax.device_put(np.array(array))
    return copied


def each(value: Vector, count: int) -> Array:
    """One number for each of so many, from these or from one that stands for all."""
    array = as_array(value)
    if array.ndim:
        return array
    return jnp.full(count, array) if is_traced(array) else as_jax(np.full(count, array))


def as_number(value: ArrayLike, dtype: Any) -> Array | np.ndarray:
    """A single number as an array; by NumPy where JAX does not trace, since JAX takes longer."""
    if is_traced(value):
        return jnp.asarray(value, dtype)
    return np.asarray(value, dtype)


def concrete(value: Any) -> np.ndarray | None:
    """The value as a NumPy array, or None while JAX traces (then it cannot be judged)."""
    return None if is_traced(value) else np.asarray(value)


def concatenate(parts: Sequence[ArrayLike]) -> Array:
    """The parts (also single numbers) one after the other; by NumPy where JAX does not trace, which
    compiles nothing.
    """
    if any(is_traced(part) for part in parts):
        return jnp.concatenate([jnp.atleast_1d(part) for part in parts])
    return as_jax(np.concatenate([np.atleast_1d(part) for part in parts]))


def stack(parts: Sequence[ArrayLike]) -> Array:
    """The parts side by side on a new first axis; by NumPy where JAX does not trace."""
    if any(is_traced(part) for part in parts):
        return jnp.stack([jnp.asarray(part) for part in parts])
    return as_jax(np.stack([np.asarray(part) for part in parts]))


def pick(array: Array, index: Any) -> Array:
    """`array[index]`; by NumPy where JAX does not trace, which compiles nothing."""
    # A single number that is picked is no array of NumPy's.
    return array[index] if is_traced(array) else as_jax(np.asarray(np.asarray(array)[index]))


def put(target: ArrayLike, index: Any, value: ArrayLike) -> Array | np.ndarray:
    """`target` with `value` at an index; by NumPy where JAX does not trace."""
    if is_traced(target) or is_traced(value):
        return jnp.asarray(target).at[index].set(value)
    changed = np.array(target)
    changed[index] = value
    return changed


def untraced(*values: ArrayLike) -> tuple[Any, ...]:
    """The values as NumPy arrays, by which nothing is compiled, unless JAX traces one of them."""
    if any(is_traced(value) for value in values):
        return tuple(jnp.asarray(value) for value in values)
    return tuple(np.asarray(value) for value in values)


def namespace(array: Any) -> Any:
    """NumPy of one of its arrays, else `jax.numpy`: for formulas that both can compute."""
    return np if isinstance(array, np.ndarray) else jnp
