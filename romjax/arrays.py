"""What users may write for numbers, and how it becomes an array."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Real

from .compat import is_traced

Number = ArrayLike
# Sequences of sequences, three deep, as lists of matrices are. Not Sequence[Any], nor a type that
# names itself: to checkers a string would be one.
_Row = Sequence[ArrayLike]
_Rows = Sequence[ArrayLike | _Row]
Vector = ArrayLike | Sequence[ArrayLike | _Rows]
Time = Real[ArrayLike, ""]  # [s]


def as_array(value: Any) -> Array:
    """`value` as a floating-point array of the precision that JAX is set to."""
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jnp.inexact):
        return value
    return jnp.asarray(value, dtype=jnp.result_type(float))


def concrete(value: Any) -> np.ndarray | None:
    """The value as a NumPy array, or None while JAX traces (then it cannot be judged)."""
    return None if is_traced(value) else np.asarray(value)
