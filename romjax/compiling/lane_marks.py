"""Marks of what a run is given, in which `jax.vmap` says where it puts the axes of lanes."""

from typing import Any

import equinox as eqx
import jax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from ..common import compat


def marked(tree: Any) -> Any:
    """The same, with a mark on each array that JAX traces."""
    traced, known = eqx.partition(tree, compat.is_traced)
    return eqx.combine(jax.tree.map(lambda x: _mark.bind(x, axes=()), traced), known)


def axes_of_lanes(equation: Any) -> tuple[int, ...] | None:
    """The axes of lanes of an array that an equation marks, the outermost batch's first; None of
    other equations.
    """
    return equation.params["axes"] if equation.primitive is _mark else None


def _batched(args: Any, dims: Any, axes: tuple[int, ...]) -> tuple[jax.Array, int]:
    (x,), (own,) = args, dims
    others = [axis + (axis >= own) for axis in axes]
    return _mark.bind(x, axes=(own, *others)), own


_mark = Primitive("lanes")
_mark.def_impl(lambda x, axes: x)
_mark.def_abstract_eval(lambda x, axes: x)
# Lanes are those of the run: the directions of its derivatives are no lanes.
ad.primitive_jvps[_mark] = lambda x, dx, axes: (_mark.bind(*x, axes=axes), *dx)
batching.primitive_batchers[_mark] = _batched
mlir.register_lowering(_mark, lambda ctx, x, axes: [x])
