"""A number that tells mechanisms with other numbers apart."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..common import compat
from ..system.base import AbstractSystem
from ..system.structure import without_names

# Where a mechanism starts, and how large its bodies are drawn, changes none of its equations.
_STARTS = {"q0", "v0", "amplitudes", "rates", "extent"}
_STARTS |= {"position", "angle", "orientation", "velocity", "angular_velocity"}
# Numbers far below may be rounding, of a length that is zero, say, and such shares of the largest
# number of their array, of what large numbers leave of each other.
_SMALLEST, _RELATIVE = 1e-9, 1e-9
# Multiples of it fill a unit evenly, so that no two weights are alike.
_GOLDEN = 0.6180339887498949
# Differences that count: of a number that differs by so large a share, whichever it is.
_SHARE = 1e-6


def signature(system: AbstractSystem) -> Float[Array | np.ndarray, ""]:
    """The weighted sum of the digits of all numbers of a `system`, but its names and its start:
    Σ wᵢ asinh(xᵢ / 10⁻⁹), 1 ≤ wᵢ < 2, of no numbers below 10⁻⁹ of the largest one of their array.
    Without derivatives.

    By NumPy where JAX does not trace.
    """
    total = _digits(system).sum()
    # A sum of NumPy is no array.
    signed: Float[Array | np.ndarray, ""] = total if compat.is_traced(total) else np.asarray(total)
    return signed


def differs(system: AbstractSystem, other: Float[ArrayLike, ""]) -> bool:
    """Whether a full `system` has other numbers than the one of the signature `other`; it has not
    where one of them is traced or holds NaN, so that nobody knows.
    """
    digits = _digits(system)
    if compat.is_traced(digits) or compat.is_traced(other):
        return False
    known = np.asarray(other)
    # Single precision has rounded each number of both.
    rounding = max(np.finfo(x.dtype).eps for x in (digits, known))
    allowed = _SHARE + 8 * rounding * np.sum(np.abs(digits))
    return bool(np.abs(digits.sum() - known) > allowed)


def _digits(system: AbstractSystem) -> Any:
    """The weighted digits of each number of the full mechanism of a `system`."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(without_names(system.full))
    numbers = [x for path, x in leaves if _is_number(x) and not _is_start(path)]
    xp: Any = np
    if any(map(compat.is_traced, numbers)):
        xp, numbers = jnp, [jax.lax.stop_gradient(x) for x in numbers]
    counted = [np.zeros(1, system.q0.dtype)]
    for x in (xp.ravel(xp.asarray(x)) for x in numbers):
        least = _RELATIVE * xp.max(xp.abs(x), initial=0.0)
        counted.append(xp.where(xp.abs(x) < least, 0, x))
    flat = xp.concatenate(counted)
    weights = 1 + np.arange(len(flat)) * _GOLDEN % 1
    return xp.arcsinh(flat / _SMALLEST) * weights.astype(flat.dtype)


def _is_number(x: Any) -> bool:
    return isinstance(x, jax.Array | np.ndarray) and jnp.issubdtype(x.dtype, jnp.inexact)


def _is_start(path: tuple[Any, ...]) -> bool:
    """Whether a path leads to a start: of the whole system, or of a body."""
    names = [str(getattr(key, "name", "")) for key in path]
    return names[-1] in _STARTS and (len(names) == 1 or names[0] == "bodies")
