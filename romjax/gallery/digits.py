"""Numbers of scenes as one writes them."""

from typing import Any, TypeVar

import jax.tree_util as jtu
import numpy as np

from ..common.arrays import as_jax, concrete, namespace

T = TypeVar("T")

# Sums and products of a few decimal numbers err by some units in the last place.
_UNITS = 8
_DIGITS = 12


def decimal(tree: T) -> T:
    """A scene, or a number, with numbers that are a short decimal but for rounding as that.

    So 0.1 + 0.2 is 0.3. Nothing else changes, nor what JAX traces.
    """
    shorter: T = jtu.tree_map(_decimal, tree)
    return shorter


def drawn(points: Any) -> Any:
    """Points of an outline [m] to the micron, and no zero with a sign."""
    return namespace(points).round(points, 6) + 0.0


def _decimal(leaf: Any) -> Any:
    known = concrete(leaf)
    if known is None or known.dtype.kind != "f":
        return leaf
    short = np.array([float(f"{x:.{_DIGITS}g}") for x in known.ravel().tolist()])
    short = short.reshape(known.shape)
    near = np.abs(short - known) <= _UNITS * np.finfo(float).eps * np.abs(known)
    changed = np.where(near, short, known)
    return leaf if np.array_equal(changed, known) else as_jax(changed.astype(known.dtype))
