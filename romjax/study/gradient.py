"""Whether a gradient is right, asked in three ways."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from tabulate import tabulate

from ..integrate.adjoint import forward_mode

# Steps of central differences, relative to the size of the number. With the second,
# twice as long, Richardson's extrapolation leaves an error of the fourth order.
_STEP = 1e-3
# What counts as zero: alone, and beside larger entries of the same array.
_ZERO, _SMALL = 1e-12, 1e-6
# Rounding of f in units of eps, when it is the end of a hundred steps.
_ROUNDING = 10
_ROWS = 20  # of the printed table


@dataclasses.dataclass(frozen=True)
class GradientCheck:
    """A gradient by reverse mode, forward mode and central differences.

    Each is a pytree like the point. `part`: where the three part most, and `error` by how much.
    Derivatives are compared times the `size` of their parameters, relative to the largest of the
    same array, or to `least` where all are smaller. `print` shows a table.
    """

    reverse: Any
    forward: Any
    central: Any
    error: float
    part: str
    size: Any
    least: float

    def __str__(self) -> str:
        rows = []
        for path, *found in _leaves(self.size, self.reverse, self.forward, self.central):
            reverse, forward, central = (np.ravel(x) for x in found[1:])
            error = _error(self.least, *found)
            for i in range(len(reverse)):
                name = path if reverse.size == 1 else f"{path}[{i}]"
                rows.append([name, reverse[i], forward[i], central[i], error])
        rows.sort(key=lambda row: -row[-1])
        header = ["", "reverse", "forward", "central", "part by"]
        table = tabulate(rows[:_ROWS], header, floatfmt=("", ".6e", ".6e", ".6e", ".0e"))
        more = f"\n... and {len(rows) - _ROWS} more" if len(rows) > _ROWS else ""
        return f"{table}{more}"


def check_gradient(f: Callable[[Any], Any], x: Any, *, step: float = _STEP) -> GradientCheck:
    """The gradient of a function by reverse mode, forward mode and central differences.

    **Arguments:**

    - `f`: from a pytree to a number, such as a Scene to something of its run. Simulations in it
      need no `adjoint`: it is chosen for each mode.
    - `x`: where; its arrays of floats are the parameters.
    - `step`: of the differences, relative to each number, or at zero to its neighbours. They see
      the errors of step size control: simulate with a tight `rtol`.

    Raises ValueError if f(x) is no finite number.
    """
    dynamic, static = eqx.partition(x, eqx.is_inexact_array_like)
    start, unravel = ravel_pytree(jax.tree.map(jnp.asarray, dynamic))

    def value(flat: jax.Array) -> Any:
        return f(eqx.combine(unravel(flat), static))

    shape = jax.eval_shape(value, start)
    if not isinstance(shape, jax.ShapeDtypeStruct) or shape.shape != ():
        raise ValueError(f"check_gradient: f must return a number, but f(x) is {shape}.")
    found = jax.jit(value)(start)
    if not jnp.isfinite(found):
        raise ValueError(f"check_gradient: f(x) = {found}; check at a place where it is finite.")
    reverse = jax.jit(jax.grad(value))(start)
    with forward_mode():
        forward = jax.jit(jax.jacfwd(value))(start)
        sizes = jax.tree.map(_size, unravel(start))
        flat, _ = ravel_pytree(sizes)
        central = _differences(value, start, step * flat)
    trees = [unravel(gradient) for gradient in (reverse, forward, central)]
    # Rounding of f leaves differences an error of some eps / step; changes of f by its root, for a
    # change of a parameter by its own size, are the least that they show to as many digits.
    least = float(jnp.sqrt(_ROUNDING * jnp.finfo(start.dtype).eps / step) * jnp.abs(found))
    errors = [(_error(least, *values), path) for path, *values in _leaves(sizes, *trees)]
    error, part = max(errors, default=(0.0, ""))
    return GradientCheck(trees[0], trees[1], trees[2], error, part, sizes, least)


def _size(x: Any) -> Any:
    """How large parameters are; those that are zero, or as good as, are like the largest beside
    them, or like one.
    """
    largest = jnp.max(jnp.abs(x), initial=0.0)
    typical = jnp.where(largest > _ZERO, largest, 1.0)
    return jnp.where(jnp.abs(x) > _SMALL * typical, jnp.abs(x), typical)


def _differences(value: Callable[[Any], Any], start: Any, steps: Any) -> Any:
    evaluate = jax.jit(value)
    slopes = []
    for unit, step in zip(jnp.eye(len(start)), steps, strict=True):
        quotients = []
        for h in (step, 2 * step):
            quotients.append((evaluate(start + h * unit) - evaluate(start - h * unit)) / (2 * h))
        slopes.append((4 * quotients[0] - quotients[1]) / 3)
    return jnp.stack(slopes)


def _leaves(*trees: Any) -> list[tuple[Any, ...]]:
    """The path of each array, and the arrays of all trees."""
    paths = [
        jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(trees[0])
    ]
    columns = [[np.asarray(leaf) for leaf in jax.tree.leaves(tree)] for tree in trees]
    return list(zip(paths, *columns, strict=True))


def _error(least: float, size: np.ndarray, *values: np.ndarray) -> float:
    """How far the values part for changes by the sizes of the parameters, relative to the largest;
    of NaNs, infinitely far.
    """
    stacked = size * np.stack(values)
    if not stacked.size:
        return 0.0
    if not np.all(np.isfinite(stacked)):
        return np.inf
    scale = max(np.max(np.abs(stacked)), least)
    return float(np.max(np.ptp(stacked, axis=0)) / scale) if scale > 0 else 0.0
