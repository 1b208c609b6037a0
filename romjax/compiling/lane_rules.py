"""Operations on arrays that have the axis of lanes last: what each takes and gives then.

`jax.vmap` puts the axis of a batch's lanes first, so that the inner loop of an operation runs over
the few numbers of one lane. With lanes last it runs over lanes, several of which LLVM computes at
once.
"""

import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from .lane_held import Held, Rule, all_moved, bind, first_axis, moved, rotated, shape_of
from .lane_indexing import gathered, part, scattered, updated

# Sums of so many products at most are written out; longer ones are products of a library.
_TERMS = 32


def apply(equation: Any, given: Sequence[Held]) -> list[Held]:
    """The results of an operation that contains no others."""
    rule = _RULES.get(equation.primitive.name)
    results = None
    if rule is not None and any(x.axis is not None for x in given):
        results = rule(equation, given)
    if results is None:
        return [Held(x) for x in bind(equation, [x.as_given() for x in given])]
    return results


def _elementwise(equation: Any, given: Sequence[Held]) -> list[Held]:
    axis = first_axis(given)
    arrays = [
        x.along(axis) if shape_of(own) else x.array
        for x, own in zip(given, equation.invars, strict=True)
    ]
    return [Held(x, axis) for x in bind(equation, arrays)]


def _joined(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    axis, along = first_axis(given), equation.params["dimension"]
    if along == axis:
        return None
    arrays = [x.along(axis) for x in given]
    return [Held(x, axis) for x in bind(equation, arrays, dimension=moved(along, axis))]


def _stacked(equation: Any, given: Sequence[Held]) -> list[Held]:
    axis, new = first_axis(given), equation.params["axis"]
    arrays = [x.along(axis) for x in given]
    return [Held(x, axis + (new <= axis)) for x in bind(equation, arrays, axis=new - (new > axis))]


def _over_axes(name: str, keeps: bool) -> Rule:
    """The rule of an operation along axes, of the parameter `name`, which it `keeps` or removes."""

    def rule(equation: Any, given: Sequence[Held]) -> list[Held] | None:
        (x, *_), own = given, equation.params[name]
        axis, axes = x.axis, own if isinstance(own, tuple) else (own,)
        if axis is None or axis in axes:
            return None
        others = all_moved(axes, axis)
        changed = {name: others if isinstance(own, tuple) else others[0]}
        after = axis if keeps else axis - sum(k < axis for k in axes)
        return [Held(y, after) for y in bind(equation, [x.array], **changed)]

    return rule


def _reduced(equation: Any, given: Sequence[Held]) -> list[Held]:
    (x,), axes = given, equation.params["axes"]
    axis: Any = x.axis
    others = tuple(sorted(x.array.ndim - 1 if k == axis else moved(k, axis) for k in axes))
    after = None if axis in axes else axis - sum(k < axis for k in axes)
    return [Held(y, after) for y in bind(equation, [x.array], axes=others)]


def _transposed(equation: Any, given: Sequence[Held]) -> list[Held]:
    (x,), order = given, equation.params["permutation"]
    axis: Any = x.axis
    others = [moved(k, axis) for k in order if k != axis]
    array = x.array
    if others != sorted(others):
        array = lax.transpose(array, (*others, len(others)))
    return [Held(array, order.index(axis))]


def _broadcast(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    (x, *others), shape = given, shape_of(equation.outvars[0])
    to, axis = equation.params["broadcast_dimensions"], x.axis
    if axis is None or others or shape[to[axis]] != x.array.shape[-1]:
        return None
    after = to[axis]
    places = [moved(k, after) for k in (*to[:axis], *to[axis + 1 :])]
    places.append(len(shape) - 1)
    return [Held(lax.broadcast_in_dim(x.array, rotated(shape, after), places), after)]


def _reshaped(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    (x, *others), new = given, shape_of(equation.outvars[0])
    axis, old = x.axis, shape_of(equation.invars[0])
    if axis is None or others or equation.params["dimensions"] is not None:
        return None
    # Lanes are an axis of their own before and after where as many numbers come before it.
    before = math.prod(old[:axis])
    for k, size in enumerate(new):
        if size == old[axis] and math.prod(new[:k]) == before:
            return [Held(lax.reshape(x.array, rotated(new, k)), k)]
    return None


def _sliced(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    (x,), params, axis = given, equation.params, given[0].axis
    if axis is None or shape_of(equation.outvars[0])[axis] != x.array.shape[-1]:
        return None
    names = ("start_indices", "limit_indices", "strides")
    changed = {name: params[name] and rotated(params[name], axis) for name in names}
    return [Held(y, axis) for y in bind(equation, [x.array], **changed)]


def _unstacked(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    (x,), along, axis = given, equation.params["axis"], given[0].axis
    if axis is None or along == axis:
        return None
    results = bind(equation, [x.array], axis=moved(along, axis))
    return [Held(y, axis - (along < axis)) for y in results]


def _padded(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    (x, value), given_pads = given, equation.params["padding_config"]
    axis = x.axis
    if axis is None or tuple(given_pads[axis]) != (0, 0, 0):
        return None
    pads = rotated(given_pads, axis)
    return [Held(y, axis) for y in bind(equation, [x.array, value.array], padding_config=pads)]


def _product(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    """A product of small matrices, as a sum."""
    (summed, batch) = equation.params["dimension_numbers"]
    sizes = dict[Any, int]()
    names = list[list[Any]]()
    for side, x in enumerate(equation.invars):
        own: list[Any] = [(side, k) for k in range(x.aval.ndim)]
        for kind, pairs in (("sum", summed), ("batch", batch)):
            for i, k in enumerate(pairs[side]):
                own[k] = kind, i
        names.append(own)
        sizes.update(zip(own, shape_of(x), strict=True))
    sums = [("sum", i) for i in range(len(summed[0]))]
    free = [name for own in names for name in own if name[0] in (0, 1)]
    results = [*(("batch", i) for i in range(len(batch[0]))), *free]
    lanes = next(own[x.axis] for own, x in zip(names, given, strict=True) if x.axis is not None)
    if lanes not in results or math.prod(sizes[name] for name in sums) > _TERMS:
        return None
    order = [*(name for name in results if name != lanes), *sums, lanes]

    def spread(x: Held, own: list[Any]) -> Any:
        axis = own.index(lanes) if lanes in own else None
        own = own if axis is None else list(rotated(own, axis))
        places = [order.index(name) for name in own]
        by_place = np.argsort(places)
        array = lax.transpose(x.along(axis), by_place)
        shape = [sizes[name] for name in order]
        return lax.broadcast_in_dim(array, shape, [places[i] for i in by_place])

    a, b = (spread(*pair) for pair in zip(given, names, strict=True))
    dtype = equation.outvars[0].aval.dtype
    # A result may be asked for in more digits than the factors have.
    wide = jnp.result_type(a, b, dtype)
    products = a.astype(wide) * b.astype(wide)
    total = jnp.sum(products, axis=tuple(range(len(results) - 1, len(order) - 1)))
    return [Held(total.astype(dtype), results.index(lanes))]


_NAMES = (
    "abs acos acosh add add_any and asin asinh atan atan2 atanh cbrt ceil clamp "
    "convert_element_type copy cos cosh div eq erf erf_inv erfc exp exp2 expm1 floor ge gt "
    "integer_pow is_finite le log log1p logistic lt max min mul ne neg nextafter not or pow rem "
    "round rsqrt select_n shift_left shift_right_arithmetic shift_right_logical sign sin sinh sqrt "
    "square stop_gradient sub tan tanh xor"
)
_SUMS = ("and", "max", "min", "or", "prod", "sum")
_RULES: dict[str, Rule] = {
    **dict.fromkeys(_NAMES.split(), _elementwise),
    **dict.fromkeys((f"reduce_{name}" for name in _SUMS), _reduced),
    **dict.fromkeys((f"cum{name}" for name in _SUMS), _over_axes("axis", True)),
    "argmax": _over_axes("axes", False),
    "argmin": _over_axes("axes", False),
    "broadcast_in_dim": _broadcast,
    "concatenate": _joined,
    "dot_general": _product,
    "dynamic_slice": part,
    "dynamic_update_slice": updated,
    "gather": gathered,
    "pad": _padded,
    "reshape": _reshaped,
    "rev": _over_axes("dimensions", True),
    "scatter": scattered,
    "scatter-add": scattered,
    "slice": _sliced,
    "split": _over_axes("axis", True),
    "squeeze": _over_axes("dimensions", False),
    "stack": _stacked,
    "transpose": _transposed,
    "unstack": _unstacked,
}
