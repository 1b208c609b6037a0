"""The errors of groups of coordinates, each relative to the motion of its own."""

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Numbers, as_number, namespace
from ..common.compat import is_traced
from ..scene.coordinate import Coordinate, groups_of
from .trajectory import Trajectory

# A group of coordinates that moves by fewer tolerances than these has no motion to be relative to.
RESOLVED = 100.0


@functools.lru_cache(maxsize=64)
def groups_with_members(
    coordinates: tuple[Coordinate, ...], dtype: Any
) -> tuple[tuple[str, ...], Float[np.ndarray, "n g"]]:
    """The groups of coordinates by name, and one for each coordinate that is in a group."""
    groups, numbers = groups_of(coordinates)
    members = np.asarray(numbers)[:, None] == np.arange(len(groups))[None]
    return groups, members.astype(dtype)


def resolution(*runs: Trajectory) -> Float[Array | np.ndarray, ""]:
    """The motion, relative to that of all coordinates, which the tolerances of runs resolve."""
    given = [run.stats.rtol for run in runs if run.stats.rtol is not None]
    # NumPy is used unless JAX traces, since an operation of its own would be compiled.
    xp: Any = jnp if any(is_traced(rtol) for rtol in given) else np
    largest = functools.reduce(xp.maximum, given, 0.0)
    return as_number(RESOLVED * largest, runs[0].q.dtype)


def group_errors(
    difference: Float[Numbers, "k n"],
    motion: Float[Numbers, "k n"],
    weights: Float[Numbers, " n"],
    members: Float[Array | np.ndarray, "n g"],
    resolved: Float[Array | np.ndarray, ""],
    size: Float[Numbers, ""],
) -> Float[Numbers, " g"]:
    """The errors of groups of coordinates, relative to their own motions where these are resolved;
    absolute where nothing moves.

    - `weights`: the diagonal of the metric. `size`: of the motion of all in it.
    """
    xp, each = namespace(difference), weights[:, None] * members
    apart, moved = (square_root(xp.sum(x**2, axis=0) @ each) for x in (difference, motion))
    least = xp.maximum(resolved, rounding(difference.dtype)) * size
    errors: Numbers = apart / xp.where(size > 0, xp.maximum(moved, least), 1)
    return errors


def rounding(dtype: Any) -> float:
    """Return the motion that rounding makes of a coordinate at rest, relative to its size."""
    return 100 * float(jnp.finfo(dtype).eps)


def square_root(squared: Float[Numbers, "..."]) -> Numbers:
    """Square roots whose gradient is zero, not NaN, where they vanish; NaN where the square is."""
    xp, nothing = namespace(squared), squared == 0
    roots: Numbers = xp.where(nothing, 0, xp.sqrt(xp.where(nothing, 1, squared)))
    return roots
