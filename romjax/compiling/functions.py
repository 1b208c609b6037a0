"""Parts of a program that XLA compiles as functions of their own, instead of as kernels."""

import functools
import itertools
from collections.abc import Callable
from typing import Any

import jax

from ..common import compat
from . import jaxprs

# Of a function, in equations: LLVM's passes need more than linear time for a long one, which only
# many runs are worth, and a short one saves nothing.
MOST, MOST_OFTEN, _FEWEST = 2500, 20_000, 20
# Products of more terms take so long that what is around them does not matter.
_LARGEST_PRODUCT = 2**16
# XLA splits the work on a larger array, in bytes, over threads, which no function can do.
_LARGEST = 2**19 - 1


def split(flat: Callable[..., Any], most: int, *arrays: Any) -> Any:
    """The results of `flat`, all that can be as functions of the program."""
    closed, shapes = jax.make_jaxpr(flat, return_shape=True)(*arrays)
    fits = functools.partial(_fits, most)
    closed = jaxprs.merged(compat.of_plain_operations(closed))
    closed = jaxprs.as_functions(closed, fits, _FEWEST)
    forms, tree = jax.tree.flatten(shapes)
    results = jaxprs.evaluate(closed, arrays)
    # Functions take arrays, and forget that a number of Python has the type of what it meets.
    typed = [jaxprs.typed_as(*pair) for pair in zip(results, forms, strict=True)]
    return jax.tree.unflatten(tree, typed)


def _fits(most: int, jaxpr: Any, repeated: bool) -> bool:
    """Whether this can be one function: no calls of a library, no large products.

    Nor large copies, which a loop that changes a few rows of an array would not make otherwise,
    where a loop around it repeats them: a batch of long runs stores its outputs that way.
    """
    # One more than a function may have says that it has too many.
    equations = list(itertools.islice(jaxprs.equations(jaxpr), most + 1))
    return (
        len(equations) <= most
        and jaxprs.is_of_real_numbers(jaxpr)
        and not (repeated and jaxprs.largest_copy(jaxpr) > _LARGEST)
        and jaxprs.largest_work(equations) <= _LARGEST
        and all(
            jaxprs.is_written_out(equation) and jaxprs.product_terms(equation) <= _LARGEST_PRODUCT
            for equation in equations
        )
    )
