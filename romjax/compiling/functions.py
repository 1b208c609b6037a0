"""Parts of a program that XLA compiles as functions of their own, instead of as kernels."""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Literal

from ..common import compat
from . import jaxprs, lanes

# The length of a function, in equations: LLVM's passes need more than linear time for a long one,
# which only many runs are worth, and a short one saves nothing.
MOST, MOST_OFTEN, _FEWEST = 2500, 20_000, 20
# How many equations outside of loops are one function. More make a single run faster, but a batch
# takes longer to compile, and a derivative of a small mechanism to run.
TOGETHER, TOGETHER_IN_JIT = 1000, 0
# Products of more terms take so long that what is around them does not matter.
_LARGEST_PRODUCT = 2**16
# XLA splits the work on a larger array, in bytes, over threads, which no function can do.
_LARGEST = 2**19 - 1
# The largest array that a group of equations takes or gives as a function, in bytes: it is copied.
_COPIED = 2**13


def split(flat: Callable[..., Any], most: int, together: int, *arrays: Any) -> Any:
    """The results of `flat`, all that can be as functions of the program.

    `most`: equations of one that a loop has together. `together`: of one that none has.
    """
    size = functools.cache(functools.partial(_size, most))
    fits = functools.partial(_fits, most, size)
    rule = Rule(fits, size, _FEWEST, together, _COPIED)
    return _changed(functools.partial(as_functions, rule=rule), flat, arrays)


def merge(flat: Callable[..., Any], *arrays: Any) -> Any:
    """The results of `flat`, in which each quantity is computed once."""
    return _changed(lambda closed: closed, flat, arrays)


def _changed(change: Callable[[Any], Any], flat: Callable[..., Any], arrays: Any) -> Any:
    """The results of `flat`, after a change of its merged jaxpr."""
    closed, shapes = jax.make_jaxpr(flat, return_shape=True)(*arrays)
    merged = jaxprs.merged(compat.of_plain_operations(closed))
    closed = change(lanes.held_last(merged))
    forms, tree = jax.tree.flatten(shapes)
    results = jaxprs.evaluate(closed, arrays)
    # Functions take arrays, and forget that a number of Python has the type of what it meets.
    typed = [jaxprs.typed_as(*pair) for pair in zip(results, forms, strict=True)]
    return jax.tree.unflatten(tree, typed)


def _fits(most: int, size: Callable[[Any], float], jaxpr: Any, repeated: bool) -> bool:
    """Whether this can be one function: no more than `most` equations, all of which it may contain.

    Nor large copies, which a loop that changes a few rows of an array would not make otherwise,
    where a loop around it repeats them: a batch of long runs stores its outputs that way.
    """
    return (
        sum(map(size, jaxpr.eqns)) <= most
        and jaxprs.is_of_real_numbers(jaxpr)
        and not (repeated and jaxprs.largest_copy(jaxpr) > _LARGEST)
    )


def _size(most: int, equation: Any) -> float:
    """The number of equations in one, itself included; infinite if it is part of no function.

    No function contains more than `most`, calls of a library or large products.
    """
    # One more than a function may have says that it has too many.
    own = list(itertools.islice(jaxprs.equations_of(equation), most + 1))
    fits = (
        len(own) <= most
        and jaxprs.largest_work(own) <= _LARGEST
        and all(
            jaxprs.is_written_out(each) and jaxprs.product_terms(each) <= _LARGEST_PRODUCT
            for each in own
        )
    )
    return len(own) if fits else math.inf


class Rule(NamedTuple):
    """Which equations are one function.

    - `fits`: whether a jaxpr is, also told whether a loop around it repeats it.
    - `size`: the number of equations in one, and itself; infinite if it is part of no function.
    - `few`: fewer are none; `together`: as many as that at most, if they are in no loop together.
    - `large`: bytes of an array that is handed to no group of equations, since that copies it.
    """

    fits: Callable[[Any, bool], bool]
    size: Callable[[Any], float]
    few: int
    together: int
    large: int


def as_functions(closed: Any, rule: Rule, repeated: bool = False) -> Any:
    """A closed jaxpr, in which all that fits is a function of its own to XLA's CPU backend.

    All of it, else groups of its equations, else each of them, else what is inside of these.
    Compiled with the older emitter of fusions only. `repeated`: whether a loop is around it.
    """
    jaxpr = closed.jaxpr
    live = [i for i, x in enumerate(jaxpr.outvars) if x.aval.size]
    if live and rule.fits(jaxpr, repeated):
        return _one_function(closed, live)
    asked, split = jaxprs.variables(jaxpr.outvars), list[Any]()
    left = _groups(jaxpr.eqns, rule)
    # The last group comes first, so that it is known what is asked for after each.
    while left:
        group = left.pop()
        call = None
        if sum(map(rule.size, group)) >= rule.few:
            call = _together(jaxpr, group, asked, rule, repeated)
        if call is None and len(group) > 1:
            left += [[equation] for equation in group]
            continue
        again = repeated or group[0].primitive.name in jaxprs.LOOPS
        inside = functools.partial(as_functions, rule=rule, repeated=again)
        split.append(call or jaxprs.with_inner(group[0], inside))
        asked |= jaxprs.variables(split[-1].invars)
    return ClosedJaxpr(jaxpr.replace(eqns=split[::-1]), closed.consts)


def _groups(equations: Iterable[Any], rule: Rule) -> list[list[Any]]:
    """Equations one after the other by groups; alone what is longer, or meets a large array."""
    groups, total = list[list[Any]](), math.inf
    for equation in equations:
        is_large = (
            max(map(jaxprs.size_in_bytes, (*equation.invars, *equation.outvars)), default=0)
            > rule.large
        )
        own = math.inf if is_large else rule.size(equation)
        total += own
        if not total <= rule.together:
            groups.append([])
            total = own
        groups[-1].append(equation)
    return groups


def _together(
    jaxpr: Any, group: Sequence[Any], asked: Iterable[Any], rule: Rule, repeated: bool
) -> Any:
    """Equations of a jaxpr as one call of a function; None where that does not fit.

    `asked`: variables that are asked for after them.
    """
    made = jaxprs.variables(x for e in group for x in e.outvars)
    read = [x for x in jaxprs.variables(x for e in group for x in e.invars) if x not in made]
    # Arrays of one number: filled within the function, they are its own, and changed in place.
    fills = [
        e
        for e in jaxpr.eqns
        if e.primitive.name == "broadcast_in_dim"
        and isinstance(e.invars[0], Literal)
        and e.outvars[0] not in made
    ]
    filled = {e.outvars[0] for e in fills}.intersection(read)
    fills = [e for e in fills if e.outvars[0] in filled]
    given = [x for x in read if x not in filled]
    results = [x for x in made if x in asked]
    alone = jaxpr.replace(
        constvars=[],
        invars=given,
        outvars=results,
        eqns=[*fills, *group],
        debug_info=jaxpr.debug_info.with_unknown_names(),
    )
    live = [i for i, x in enumerate(results) if x.aval.size]
    if not live or not rule.fits(alone, repeated):
        return None
    (call,) = _one_function(ClosedJaxpr(alone, ()), live).jaxpr.eqns
    return call.replace(invars=[x for x in given if x.aval.size], outvars=results)


def _one_function(closed: Any, live: Sequence[int]) -> Any:
    """A closed jaxpr of one call, that of the given one as a function of its own.

    `live`: those of its results, with entries, that are asked for; JAX leaves out the others.
    """

    def inside(*given: Any) -> list[Any]:
        left, avals = iter(given), closed.in_avals
        arrays = [next(left) if x.size else jnp.zeros(x.shape, x.dtype) for x in avals]
        # The attribute is of the call alone: calls inside would inherit it without another value.
        with set_xla_metadata(xla_cpu_small_call="false", inlineable="true"):
            results: list[Any] = jaxprs.evaluate(closed, arrays)
            i = min(live, key=lambda i: np.size(results[i]))
            results[i] = _as_if_it_used(results[i], arrays)
            return results

    @jax.jit
    def call(*given: Any) -> list[Any]:
        # What is constant would be put into the function, which then does not use the argument.
        given = jax.lax.optimization_barrier(given)
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            results: list[Any] = jax.jit(inside)(*given)
            return results

    return jax.make_jaxpr(lambda *arrays: call(*(x for x in arrays if x.size)))(*closed.in_avals)


def _as_if_it_used(result: Any, arrays: Sequence[Any]) -> Any:
    """The result, by an expression of all arrays, of which the compiler cannot take any out.

    XLA ends the process at a function that does not use one of its arguments.
    """
    # Primitives are used since an index of NumPy's way is several operations, for each argument.
    first = [_first(x).reshape(()) for x in arrays if x.size]
    numbers = [x for x in first if jnp.issubdtype(x.dtype, jnp.floating)]
    others = [x.astype(jnp.float32) for x in first if not jnp.issubdtype(x.dtype, jnp.floating)]
    # Weights, since the compiler knows that no truth value, as a number, is the one compared with.
    total = sum(x * np.float32(0.7391 + 0.01 * i) for i, x in enumerate(others))
    never = sum(numbers, total) == np.float32(1.2345678e-30)
    # Only the first number is changed: XLA would split a sum over all of a large array over
    # threads.
    one = _first(result)
    # Nothing is added otherwise, which would take the sign of a zero.
    one = one ^ never if result.dtype == bool else jnp.where(never, one + 1, one)
    return jax.lax.dynamic_update_slice(result, one, (0,) * result.ndim)


def _first(x: Any) -> Any:
    """The first number of an array, as an array of as many axes."""
    return jax.lax.slice(x, (0,) * x.ndim, (1,) * x.ndim)
