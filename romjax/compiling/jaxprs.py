"""Jaxprs, JAX's traced functions: what they compute, and with which operations.

Of JAX's interface this uses what is not public; tests/test_compat.py fails when it changes.
"""

import collections
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jax._src import core
from jax._src.interpreters import partial_eval
from jax._src.lax import lax
from jax.extend.core import ClosedJaxpr

from ..common import compat

# Primitives that XLA's CPU backend writes out itself, without calls of a library or of Python.
_NAMES = (
    "abs acos acosh add add_any and argmax argmin asin asinh atan atan2 atanh "
    "bitcast_convert_type broadcast_in_dim cbrt ceil checkpoint clamp closed_call concatenate "
    "cond convert_element_type copy cos cosh cummax cummin cumprod cumsum custom_jvp_call "
    "custom_linear_solve custom_vjp_call div dot_general dynamic_slice dynamic_update_slice eq "
    "erf erf_inv erfc exp exp2 expm1 floor gather ge gt integer_pow iota is_finite jit le log "
    "lanes log1p logistic lt max maybe_set min mul name ne neg nextafter nonbatchable "
    "nondifferentiable nondifferentiable_backward not optimization_barrier or pad pjit "
    "polynomial population_count pow reduce_and reduce_max reduce_min reduce_or reduce_prod "
    "reduce_sum rem remat reshape rev round rsqrt scan scatter scatter-add select_if_vmap "
    "select_n shift_left "
    "shift_right_arithmetic shift_right_logical sign sin sinh slice split sqrt square squeeze "
    "stack stop_gradient sub tan tanh tile transpose unstack unvmap_all unvmap_any unvmap_max "
    "while xor "
)
_WRITTEN_OUT = frozenset(_NAMES.split())
# Loops, branches and calls, in which there is something to change.
LOOPS = frozenset(("while", "scan"))
_WITH_INNER = LOOPS | {"cond", "jit", "pjit", "custom_jvp_call", "custom_vjp_call"}
# Operations of equinox's loops, which are written by those of JAX when they are compiled.
_OF_EQUINOX = frozenset(
    ("maybe_set", "nonbatchable", "select_if_vmap", "unvmap_all", "unvmap_any", "vprim")
)
# What changes a part of an array, or fills one.
_CHANGES = frozenset(("dynamic_update_slice", "scatter", "scatter-add"))
_IN_PLACE = _CHANGES | {"broadcast_in_dim"}


def equations(jaxpr: Any) -> Iterator[Any]:
    """All equations of a jaxpr, those inside of others too."""
    for equation in jaxpr.eqns:
        yield from equations_of(equation)


def equations_of(equation: Any) -> Iterator[Any]:
    """An equation, and all that are inside of it."""
    yield equation
    for inner in core.jaxprs_in_params(equation.params):
        yield from equations(inner)


def is_written_out(equation: Any) -> bool:
    """Whether XLA's CPU backend writes this equation out itself."""
    return equation.primitive.name in _WRITTEN_OUT


def is_of_real_numbers(jaxpr: Any) -> bool:
    """Whether all that goes in and out are real numbers, whole ones and truth values.

    Keys of random numbers are of no such type, and no sum of complex numbers stands for being used.
    """
    arrays: list[Any] = [x.aval for x in (*jaxpr.constvars, *jaxpr.invars, *jaxpr.outvars)]
    return all(getattr(x.dtype, "kind", "O") in "biuf" for x in arrays)


def product_terms(equation: Any) -> int:
    """The number of multiplications in a matrix product; zero for everything else."""
    if equation.primitive.name != "dot_general":
        return 0
    (contracted, _), _ = equation.params["dimension_numbers"]
    left, out = equation.invars[0].aval.shape, equation.outvars[0].aval.shape
    return int(np.prod(out)) * int(np.prod([left[axis] for axis in contracted]))


def largest_copy(jaxpr: Any) -> int:
    """The bytes of the largest argument that a loop or an operation changes, and so copies."""
    return max((size_in_bytes(x) for x in _changed(jaxpr)), default=0)


def _changed(jaxpr: Any) -> set[Any]:
    """Return the arguments of a jaxpr that are changed in it, in its inner jaxprs too."""
    changed: list[Any] = []
    for equation in jaxpr.eqns:
        arguments, name = equation.invars, equation.primitive.name
        if name == "scan":
            first, count = compat.scan_counts(equation.params)
            changed += arguments[first : first + count]
        elif name == "while":
            changed += arguments[-len(equation.outvars) :]
        elif name in _CHANGES:
            changed += arguments[:1]
        elif name in _WITH_INNER:
            for inner in core.jaxprs_in_params(equation.params):
                inside = _changed(inner)
                # A branch is chosen by the first argument, which is none of the branches' own.
                pairs = zip(reversed(arguments), reversed(inner.invars), strict=False)
                changed += [x for x, y in pairs if y in inside]
    return {x for x in changed if not isinstance(x, core.Literal)}.intersection(jaxpr.invars)


def largest_work(equations: Iterable[Any]) -> int:
    """The bytes of the largest array that one of these operations computes as a whole."""
    parts = (e for e in equations if e.primitive.name not in _WITH_INNER | _IN_PLACE)
    return max((size_in_bytes(x) for e in parts for x in e.outvars), default=0)


def size_in_bytes(x: Any) -> int:
    """The bytes of a variable's or a number's array."""
    aval: Any = x.aval
    return int(aval.size) * int(aval.dtype.itemsize)


def merged(closed: Any) -> Any:
    """A closed jaxpr in which each quantity is computed once, and none that nobody asks for.

    XLA merges equal operations too, but late: until then it takes time for each of them.
    """
    return _merged(closed, (), {})


def _merged(closed: Any, given: Sequence[Any], done: dict[Any, tuple[Any, Any]]) -> Any:
    """`given`: to the first arguments, the same to some of them. `done`: jaxprs before and after,
    by identity, so that what is called twice stays one.
    """
    first_of = dict[Any, int]()
    same = [
        i if isinstance(x, core.Literal) else first_of.setdefault(x, i) for i, x in enumerate(given)
    ]
    called = id(closed), tuple(same)
    if called in done:
        return done[called][1]
    jaxpr = _without_rules(closed.jaxpr)
    # What nobody uses first: it may be all that tells two equations apart.
    jaxpr, _ = partial_eval.dce_jaxpr(jaxpr, [True] * len(closed.out_avals), True)
    first, different = dict[Any, Any](), list[Any]()
    equal = {x: jaxpr.invars[i] for x, i in zip(jaxpr.invars, same, strict=False)}
    # Each trace of one function brings constants of its own, which are alike.
    values = dict[Any, Any]()
    for x, value in zip(jaxpr.constvars, closed.consts, strict=True):
        aval: Any = x.aval
        # Keys of random numbers have no bytes.
        if not compat.is_traced(value) and isinstance(aval.dtype, np.dtype):
            equal[x] = values.setdefault((aval, np.asarray(value).tobytes()), x)

    def original(x: Any) -> Any:
        return x if isinstance(x, core.Literal) else equal.get(x, x)

    for equation in jaxpr.eqns:
        equation = equation.replace(invars=[original(x) for x in equation.invars])
        equation = _with_named(equation, functools.partial(_merged_with, _handed(equation), done))
        operands = (_literal(x) if isinstance(x, core.Literal) else x for x in equation.invars)
        try:
            key = (equation.primitive, *operands, frozenset(equation.params.items()))
            # Equations with effects are not merged: each of them happens.
            before = equation if equation.effects else first.setdefault(key, equation)
        except TypeError:  # of parameters that cannot be compared
            before = equation
        if before is equation:
            different.append(equation)
        else:
            equal.update(zip(equation.outvars, before.outvars, strict=True))
    jaxpr = jaxpr.replace(eqns=different, outvars=[original(x) for x in jaxpr.outvars])
    new = ClosedJaxpr(jaxpr, closed.consts)
    done[called] = closed, new
    return new


def _merged_with(
    handed: dict[str, Sequence[Any]], done: dict[Any, tuple[Any, Any]], closed: Any, name: str
) -> Any:
    return _merged(closed, handed[name], done)


def _handed(equation: Any) -> dict[str, Sequence[Any]]:
    """What an equation hands to the first arguments of its inner jaxprs, by their names, as long as
    no loop changes it.
    """
    handed, params = collections.defaultdict[str, Sequence[Any]](tuple), equation.params
    match equation.primitive.name:
        case "jit" | "pjit":
            handed["jaxpr"] = equation.invars
        case "cond":
            handed["branches"] = equation.invars[1:]
        case "scan":
            fixed, _ = compat.scan_counts(params)
            handed["jaxpr"] = equation.invars[:fixed]
        case "while":
            of_condition, of_body = params["cond_nconsts"], params["body_nconsts"]
            handed["cond_jaxpr"] = equation.invars[:of_condition]
            handed["body_jaxpr"] = equation.invars[of_condition : of_condition + of_body]
    return handed


def _without_rules(jaxpr: Any) -> Any:
    """A jaxpr with the equations of functions that have a derivative of their own in the places of
    their calls.

    Of what is compiled no derivative is taken any more, and two calls of one function are never
    equal, since each has its own rule.
    """
    if all(e.primitive.name != "custom_jvp_call" for e in jaxpr.eqns):
        return jaxpr
    new, equations, known = core.gensym(), list[Any](), dict[Any, Any]()

    def read(x: Any) -> Any:
        return x if isinstance(x, core.Literal) else known.get(x, x)

    for equation in jaxpr.eqns:
        equation = equation.replace(invars=[read(x) for x in equation.invars])
        called = equation.params.get("call_jaxpr")
        if equation.primitive.name != "custom_jvp_call" or called.consts:
            equations.append(equation)
            continue
        inner = _without_rules(called.jaxpr)
        known.update(zip(inner.invars, equation.invars, strict=True))
        for each in inner.eqns:
            # One function may be called twice, but a variable has one value.
            results = [new(x.aval) for x in each.outvars]
            equations.append(each.replace(invars=[read(x) for x in each.invars], outvars=results))
            known.update(zip(each.outvars, results, strict=True))
        known.update(zip(equation.outvars, map(read, inner.outvars), strict=True))
    return jaxpr.replace(eqns=equations, outvars=[read(x) for x in jaxpr.outvars])


def _literal(x: Any) -> tuple[Any, ...]:
    return x.aval, np.asarray(x.val).tobytes()


def with_inner(equation: Any, change: Callable[[Any], Any]) -> Any:
    """A loop, branch or call with its jaxprs changed; any other equation as it is."""
    return _with_named(equation, lambda inner, name: change(inner))


def _with_named(equation: Any, change: Callable[[Any, str], Any]) -> Any:
    """The same for a change that depends on the name of each jaxpr in the equation."""
    if equation.primitive.name not in _WITH_INNER:
        return equation

    def inside(x: Any, name: str) -> Any:
        if isinstance(x, tuple):
            return tuple(inside(each, name) for each in x)
        return change(x, name) if isinstance(x, ClosedJaxpr) else x

    params = {name: inside(value, name) for name, value in equation.params.items()}
    return equation.replace(params=params)


def plain(equation: Any) -> Any:
    """What one of equinox's operations stands for, as a closed jaxpr; None of other operations."""
    if equation.primitive.name not in _OF_EQUINOX:
        return None
    impl = functools.partial(equation.primitive.impl, **equation.params)
    given = [jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype) for x in equation.invars]
    return jax.make_jaxpr(impl)(*given)


def variables(given: Iterable[Any]) -> dict[Any, None]:
    """The variables among these, each once, in their order."""
    return {x: None for x in given if not isinstance(x, core.Literal)}


def evaluate(closed: Any, arrays: Sequence[Any]) -> list[Any]:
    """The results of a closed jaxpr."""
    results: list[Any] = core.eval_jaxpr(closed.jaxpr, closed.consts, *arrays)
    return results


def typed_as(x: Any, form: jax.ShapeDtypeStruct) -> Any:
    """An array whose type gives way to another's where that of `form` does."""
    return lax._convert_element_type(x, weak_type=True) if form.weak_type else x
