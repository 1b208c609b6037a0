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

from ...compiling.xla import jit
from ...integrate.adjoint import forward_mode

# The least step of central differences, relative to the size of the number, and how many there are,
# each twice as long as the one before: a number that is zero changes by the step itself, too much
# for a small mechanism, or by so little that only rounding of f is seen.
_STEP, _COUNT = 1e-3, 4
# What counts as zero: in itself, and beside larger entries of the same array.
_ZERO, _SMALL = 1e-12, 1e-6
# Rounding of f in units of eps, when it is the end of a hundred steps.
_ROUNDING = 10
_ROWS = 20  # of the printed table


@dataclasses.dataclass(frozen=True)
class GradientCheck:
    """A gradient by reverse mode, forward mode and central differences.

    Each is a pytree like the point. `part`: where the three differ most, and `error` by how much.
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
        for path, *arrays in _leaves(self.size, self.reverse, self.forward, self.central):
            reverse, forward, central = (np.ravel(x) for x in arrays[1:])
            error = _error(self.least, *arrays)
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
    - `step`: the least of four, relative to each number, or at zero to its neighbours, from which
      differences are extrapolated. They see the errors of step size control: simulate with a tight
      `rtol`.

    Raises ValueError if f(x) is no finite number.
    """
    dynamic, static = eqx.partition(x, eqx.is_inexact_array_like)
    start, unravel = ravel_pytree(jax.tree.map(jnp.asarray, dynamic))

    def value(flat: jax.Array) -> Any:
        return f(eqx.combine(unravel(flat), static))

    evaluate = jit(value)
    shape = evaluate.eval_shape(start)
    if not isinstance(shape, jax.ShapeDtypeStruct) or shape.shape != ():
        raise ValueError(f"check_gradient: f must return a number, but f(x) is {shape}.")
    with forward_mode():
        at_start = np.asarray(evaluate(start))
        if not np.isfinite(at_start):
            raise ValueError(f"check_gradient: f(x) = {at_start}; check where it is finite.")
        forward = jit(jax.jacfwd(value))(start)
        sizes = jax.tree.map(_size, dynamic)
        each = [np.ravel(size) for size in jax.tree.leaves(sizes)]
        central = _differences(evaluate, np.asarray(start), step * np.concatenate([*each, []]))
    reverse = jit(jax.grad(value))(start)
    # Under jit, since every part that is taken out alone would be compiled.
    trees = jit(lambda *gradients: [unravel(x) for x in gradients])(reverse, forward, central)
    # Rounding of f leaves differences an error of some eps / step; changes of f by its root, for a
    # change of a parameter by its own size, are the least that they show to as many digits.
    least = float(np.sqrt(_ROUNDING * np.finfo(start.dtype).eps / step) * np.abs(at_start))
    errors = [(_error(least, *values), path) for path, *values in _leaves(sizes, *trees)]
    error, part = max(errors, default=(0.0, ""))
    return GradientCheck(trees[0], trees[1], trees[2], error, part, sizes, least)


def _size(x: Any) -> Any:
    """How large parameters are; those that are zero, or as good as, are like the largest beside
    them, or like one.
    """
    own = np.abs(np.asarray(x))
    largest = np.max(own, initial=0.0)
    typical = largest if largest > _ZERO else 1.0
    return np.where(own > _SMALL * typical, own, typical)


def _differences(
    evaluate: Callable[[Any], Any], start: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Return central differences, by NumPy since each operation of JAX would be compiled."""
    slopes = np.zeros_like(start)
    for i, step in enumerate(steps):
        quotients = []
        for h in step * 2.0 ** np.arange(_COUNT):
            unit = (h * (np.arange(len(start)) == i)).astype(start.dtype)
            change = np.asarray(evaluate(start + unit)) - np.asarray(evaluate(start - unit))
            quotients.append(change / (2 * h))
        slopes[i] = _extrapolated(np.array(quotients))
    return slopes


def _extrapolated(quotients: np.ndarray) -> Any:
    """The limit of quotients for steps each twice as long as the one before: of all extrapolations
    in h², the one that differs least from those that it is made of (Ridders 1982,
    doi:10.1016/S0141-1195(82)80057-0). Of quotients that are not finite, NaN.
    """
    row, best, least = quotients, np.nan, np.inf
    for order in range(1, len(quotients)):
        finer, coarser = row[:-1], row[1:]
        with np.errstate(invalid="ignore"):
            # Quotients for h and 2h err by c h^2k and 4ᵏ c h^2k: this combination is without that
            # term.
            row = finer + (finer - coarser) / (4**order - 1)
            apart = np.maximum(np.abs(row - finer), np.abs(row - coarser))
        apart = np.where(np.isfinite(apart), apart, np.inf)
        k = int(np.argmin(apart))
        if apart[k] < least:
            best, least = row[k], apart[k]
    return best


def _leaves(*trees: Any) -> list[tuple[Any, ...]]:
    """The path of each array, and the arrays of all trees."""
    paths = [
        jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(trees[0])
    ]
    columns = [[np.asarray(leaf) for leaf in jax.tree.leaves(tree)] for tree in trees]
    return list(zip(paths, *columns, strict=True))


def _error(least: float, size: np.ndarray, *values: np.ndarray) -> float:
    """How far the values differ for changes by the sizes of the parameters, relative to the
    largest; of NaNs, infinitely far.
    """
    stacked = size * np.stack(values)
    if not stacked.size:
        return 0.0
    if not np.all(np.isfinite(stacked)):
        return np.inf
    scale = max(np.max(np.abs(stacked)), least)
    return float(np.max(np.ptp(stacked, axis=0)) / scale) if scale > 0 else 0.0
