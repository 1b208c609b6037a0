"""What romjax uses of JAX, diffrax and equinox that is not public, one function for each.

Every function has a test in tests/test_compat.py that fails when the interface behind it changes.
The upper bound of jax in pyproject.toml stands for the newest version these tests have passed with.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from diffrax._term import AdjointTerm, WrapTerm
from jax._src import config, core, xla_bridge
from jax._src.interpreters import partial_eval
from jax.experimental import serialize_executable
from jax.experimental.xla_metadata import set_xla_metadata
from jaxlib.cpu import _lapack

# Options of a program. The newer way of compiling fusions takes twice as long, and a function that
# holds its results cannot be compiled. Sums over small axes stay in the loops around them: a
# library for large ones would take them out, one call for each.
OPTIONS: dict[str, Any] = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_experimental_ynn_fusion_type": "",
}
# For a program that runs once or twice: it compiles in a third of the time.
QUICK: dict[str, Any] = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
}

# Primitives that XLA's CPU backend writes out itself, without calls of a library or of Python.
_NAMES = (
    "abs acos acosh add add_any and argmax argmin asin asinh atan atan2 atanh "
    "bitcast_convert_type broadcast_in_dim cbrt ceil checkpoint clamp closed_call concatenate "
    "cond convert_element_type copy cos cosh cummax cummin cumprod cumsum custom_jvp_call "
    "custom_linear_solve custom_vjp_call div dot_general dynamic_slice dynamic_update_slice eq "
    "erf erf_inv erfc exp exp2 expm1 floor gather ge gt integer_pow iota is_finite jit le log "
    "log1p logistic lt max maybe_set min mul name ne neg nextafter nonbatchable "
    "nondifferentiable nondifferentiable_backward not optimization_barrier or pad pjit "
    "population_count pow reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum rem "
    "remat reshape rev round rsqrt scan scatter scatter-add select_if_vmap select_n shift_left "
    "shift_right_arithmetic shift_right_logical sign sin sinh slice split sqrt square squeeze "
    "stack stop_gradient sub tan tanh transpose unstack unvmap_all unvmap_any unvmap_max while "
    "xor "
)
_WRITTEN_OUT = frozenset(_NAMES.split())


# Versions of JAX whose compiler is known to know the flags below.
_FIRST, _AFTER = (0, 9), (0, 11)

_FLAGS = (
    # The newer way of compiling fusions takes twice as long, and loops that hold its results
    # cannot be compiled as one.
    "--xla_cpu_use_fusion_emitters=false",
    # Loops of less than 16 MiB become one function instead of a list of kernels, each of which
    # costs more to start than to run: chains of hundreds of bars, and batches of a thousand lanes.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=16777216",
    # Sums over small axes stay in the loops around them. A library for large ones would take them
    # out, one call for each: that halves the rate of batches.
    "--xla_cpu_experimental_ynn_fusion_type=",
)


def compiler_flags() -> tuple[str, ...]:
    """Flags of XLA for small mechanisms on a CPU; none for versions of JAX that may not know them.

    XLA ends the process at a flag that it does not know.
    """
    return _FLAGS if _FIRST <= jax.__version_info__ < _AFTER else ()


def compiler_is_set_up() -> bool:
    """Whether JAX has computed something, so that XLA reads no flags any more."""
    return xla_bridge.backends_are_initialized()


def is_outermost() -> bool:
    """Whether JAX traces nothing, so that a program that starts here is one of its own."""
    return core.trace_state_clean()


def equations(jaxpr: Any) -> Iterator[Any]:
    """All equations of a jaxpr, those inside of others too."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in core.jaxprs_in_params(equation.params):
            yield from equations(inner)


def is_written_out(equation: Any) -> bool:
    """Whether XLA's CPU backend writes this equation out itself."""
    return equation.primitive.name in _WRITTEN_OUT


def product_terms(equation: Any) -> int:
    """The number of multiplications in a matrix product; zero for everything else."""
    if equation.primitive.name != "dot_general":
        return 0
    (contracted, _), _ = equation.params["dimension_numbers"]
    left, out = equation.invars[0].aval.shape, equation.outvars[0].aval.shape
    return int(np.prod(out)) * int(np.prod([left[axis] for axis in contracted]))


def largest_copy(jaxpr: Any) -> int:
    """The bytes of the largest argument that a loop changes, and therefore copies."""
    given = set(jaxpr.invars)
    loops = (e for e in jaxpr.eqns if e.primitive.name in ("while", "scan"))
    changed = (x for loop in loops for x in loop.invars[-len(loop.outvars) :])
    copied = (x for x in changed if not isinstance(x, core.Literal) and x in given)
    arrays: list[Any] = [x.aval for x in copied]
    return max((x.size * x.dtype.itemsize for x in arrays), default=0)


def as_functions(closed: Any, fits: Callable[[Any], bool], few: int) -> Any:
    """A closed jaxpr, in which all that `fits` is a function of its own to XLA's CPU backend.

    All of it, else each loop or call in it, else what is inside of these; but for those of `few`
    equations. Compiled with the older emitter of fusions only.
    """
    jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(closed.out_avals), True)
    closed = core.ClosedJaxpr(jaxpr, closed.consts)
    results: list[Any] = jaxpr.outvars
    live = [i for i, x in enumerate(results) if x.aval.size]
    if live and fits(jaxpr):
        return _one_function(closed, live)

    def inside(x: Any) -> Any:
        if isinstance(x, tuple):
            return tuple(inside(each) for each in x)
        return as_functions(x, fits, few) if isinstance(x, core.ClosedJaxpr) else x

    # Arrays of one number, which nothing else holds: a loop may change them without a copy.
    filled = {
        e.outvars[0]: e
        for e in jaxpr.eqns
        if e.primitive.name == "broadcast_in_dim" and isinstance(e.invars[0], core.Literal)
    }
    asked = {x for e in jaxpr.eqns for x in e.invars if not isinstance(x, core.Literal)}
    asked |= {x for x in jaxpr.outvars if not isinstance(x, core.Literal)}

    def replaced(equation: Any) -> Any:
        if sum(1 for x in core.jaxprs_in_params(equation.params) for _ in equations(x)) < few:
            return equation
        read = {x: None for x in equation.invars if not isinstance(x, core.Literal)}
        fills = [filled[x] for x in read if x in filled]
        read = {x: None for x in read if x not in filled}
        alone = jaxpr.replace(
            constvars=[],
            invars=list(read),
            outvars=equation.outvars,
            eqns=[*fills, equation],
            debug_info=jaxpr.debug_info.with_unknown_names(),
        )
        live = [i for i, x in enumerate(equation.outvars) if x in asked and x.aval.size]
        if live and fits(alone):
            (call,) = _one_function(core.ClosedJaxpr(alone, ()), live).jaxpr.eqns
            return call.replace(invars=[x for x in read if x.aval.size], outvars=equation.outvars)
        if equation.primitive.name not in ("while", "scan", "cond", "jit", "pjit"):
            return equation
        params = {name: inside(value) for name, value in equation.params.items()}
        return equation.replace(params=params)

    split = jaxpr.replace(eqns=[replaced(equation) for equation in jaxpr.eqns])
    return core.ClosedJaxpr(split, closed.consts)


def _one_function(closed: Any, live: Sequence[int]) -> Any:
    """A closed jaxpr of one call, that of the given one as a function of its own.

    `live`: those of its results, with entries, that are asked for; JAX leaves out the others.
    """

    def inside(*given: Any) -> list[Any]:
        left, avals = iter(given), closed.in_avals
        arrays = [next(left) if x.size else jnp.zeros(x.shape, x.dtype) for x in avals]
        # The attribute is of the call alone: calls inside would inherit it without another value.
        with set_xla_metadata(xla_cpu_small_call="false", inlineable="true"):
            results: list[Any] = core.eval_jaxpr(closed.jaxpr, closed.consts, *arrays)
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
    first = [x.ravel()[0].astype(jnp.float32) for x in arrays if x.size]
    # Weights, since the compiler knows that no truth value, as a number, is the one compared with.
    total = sum(x * np.float32(0.7391 + 0.01 * i) for i, x in enumerate(first))
    never = total == np.float32(1.2345678e-30)
    # Of the first number alone: XLA would split a sum over all of a large array over threads.
    start = (0,) * result.ndim
    one = jax.lax.dynamic_slice(result, start, (1,) * result.ndim)
    one = one ^ never if result.dtype == bool else one + never.astype(result.dtype)
    return jax.lax.dynamic_update_slice(result, one, start)


def evaluate(closed: Any, arrays: Sequence[Any]) -> list[Any]:
    """The results of a closed jaxpr."""
    results: list[Any] = core.eval_jaxpr(closed.jaxpr, closed.consts, *arrays)
    return results


def trace_settings() -> tuple[Any, ...]:
    """JAX's settings in this thread that programs depend on, outside of its transformations."""
    return tuple(x for x in config.trace_context() if not isinstance(x, core.AxisEnv))


def dump_executable(compiled: Any) -> tuple[Any, ...]:
    """A compiled program of positional arrays, in what can be pickled."""
    binary, _, tree = serialize_executable.serialize(compiled)
    # A structure of results is an example of them, since it cannot be pickled itself.
    return binary, len(compiled.in_avals[0]), jax.tree.unflatten(tree, range(tree.num_leaves))


def load_executable(binary: bytes, count: int, example: Any) -> Any:
    """A compiled program of `count` arrays, from what `dump_executable` returns."""
    _lapack.initialize()  # as tracing a call of it would
    return serialize_executable.deserialize_and_load(
        binary,
        jax.tree.structure(((0,) * count, {})),
        jax.tree.structure(example),
        execution_devices=jax.local_devices()[:1],
    )


def depends_on_first(function: Callable[..., Any], *args: Any) -> bool:
    """Whether the first argument of a function is used in it."""
    # A function of its own: JAX would compare the arrays of a bound method.
    jaxpr = jax.make_jaxpr(lambda *args: function(*args))(*args).jaxpr
    first = jaxpr.invars[0]
    used = [atom for equation in jaxpr.eqns for atom in equation.invars] + jaxpr.outvars
    return any(atom is first for atom in used)


def is_traced(value: Any) -> bool:
    """Whether JAX traces this value, so that its number is not available."""
    return isinstance(value, jax.core.Tracer)


def trace_context(default: Any) -> Any:
    """A setting that is part of the key of JAX's caches: `.value`, and `with setting(value):`.

    A function that is compiled is traced again under another value. Not in JAX's documentation.
    """
    return jax.make_user_context(default)


def unwrap_term(term: Any) -> tuple[Any, Any]:
    """A term without the direction of time that diffrax wraps around it, and that direction."""
    return (term.term, term.direction) if isinstance(term, WrapTerm) else (term, 1)


def wrap_term(
    term: diffrax.AbstractTerm[Any, Any], direction: Any
) -> diffrax.AbstractTerm[Any, Any]:
    """A term with the direction of time, 1 or −1, that diffrax wraps around it."""
    return WrapTerm(term, direction)


def parts_of_term(term: Any) -> tuple[Any, ...]:
    """The terms that a term of diffrax is made of; none for one that stands alone."""
    if isinstance(term, WrapTerm | AdjointTerm):
        return (term.term,)
    return tuple(term.terms) if isinstance(term, diffrax.MultiTerm) else ()


def scan_kind(solver: Any) -> Any:
    """The kind of loop over a Runge–Kutta method's stages.

    diffrax's adjoints set it in what they take for such a method, a wrapped one too.
    """
    return solver.scan_kind


def control_arguments(solver: diffrax.AbstractSolver[Any]) -> Any:
    """What a solver passes on to `contr` of its terms; diffrax asks a wrapper for it."""
    return solver.term_compatible_contr_kwargs
