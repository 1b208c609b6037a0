"""Private interfaces of JAX, diffrax and equinox that romjax uses, one function for each.

Every function has a test in tests/test_compat.py that fails when the interface behind it changes.
The upper bound of jax in pyproject.toml stands for the newest version these tests have passed with.
"""

import contextlib
import math
import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NoReturn, TypeVar

import diffrax
import jax
from diffrax._term import AdjointTerm, WrapTerm
from equinox._module._flatten import MISSING
from jax._src import config, core, logging_config, xla_bridge
from jax._src.interpreters import ad, partial_eval
from jax.experimental import serialize_executable
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir
from jaxlib import utils
from jaxlib.cpu import _lapack

from .errors import InputError

M = TypeVar("M")

# Versions of JAX whose compiler is known, from the first to before the last; and the first one
# that has lost the older way of compiling fusions.
_FIRST, _AFTER = (0, 9), (0, 13)
_NEWER_FUSIONS = (0, 11)
# The first one that reads programs in silence. Those before write kilobytes for each, on hints that
# every program has for how fast instructions are, as if it might not run where it was compiled.
_SILENT = (0, 10, 2)

# For a program that runs once or twice: it compiles in a third of the time.
QUICK: dict[str, Any] = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
}


def compiler_options() -> dict[str, Any]:
    """Options of XLA for one program of a small mechanism on a CPU.

    Products stay on their thread: handing one of a few thousand terms to another takes longer than
    computing it, and waits where other programs run. Sums over small axes stay in the loops around
    them: a library for large ones would take them out, one call for each. The newer way of
    compiling fusions takes twice as long.
    """
    options = {"xla_cpu_multi_thread_eigen": False, "xla_cpu_experimental_ynn_fusion_type": ""}
    older = {"xla_cpu_use_fusion_emitters": False}
    return options | older if compiles_functions() else options


def compiles_functions() -> bool:
    """Whether XLA compiles a part of a program as one function that holds fusions.

    The newer way of compiling these cannot, and the older one has left JAX with version 0.11.
    """
    return bool(jax.__version_info__ < _NEWER_FUSIONS)


def compiler_flags() -> tuple[str, ...]:
    """Flags of XLA for small mechanisms on a CPU; none for versions of JAX that may not know them.

    XLA ends the process at a flag that it does not know. Loops of less than 16 MiB become one
    function instead of a list of kernels, each of which costs more to start than to run: chains of
    hundreds of bars, and batches of a thousand lanes. The others are as in `compiler_options`; sums
    that a library takes out of their loops halve the rate of batches.
    """
    if not _FIRST <= jax.__version_info__ < _AFTER:
        return ()
    flags = (
        "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=16777216",
        "--xla_cpu_experimental_ynn_fusion_type=",
    )
    older = ("--xla_cpu_use_fusion_emitters=false",)
    return flags + older if compiles_functions() else flags


def compiler_is_set_up() -> bool:
    """Whether JAX has computed something, so that XLA reads no flags any more."""
    return xla_bridge.backends_are_initialized()


def is_outermost() -> bool:
    """Whether JAX traces nothing, so that a program that starts here is one of its own."""
    return core.trace_state_clean()


def is_differentiating() -> bool:
    """Whether JAX takes derivatives of numbers that it knows, in no program and no batch."""
    trace, derivatives = core.trace_ctx.trace, (ad.JVPTrace, ad.LinearizeTrace)
    while isinstance(trace, derivatives):
        trace = trace.parent_trace
    return trace is not core.trace_ctx.trace and isinstance(trace, core.EvalTrace)


def trace_settings() -> tuple[Any, ...]:
    """JAX's settings in this thread that programs depend on, outside of its transformations."""
    return tuple([x for x in config.trace_context() if type(x) is not core.AxisEnv])


@contextlib.contextmanager
def without_cache_of_jax() -> Iterator[None]:
    """Nothing that this thread compiles inside comes from JAX's own cache on disk or goes there.

    What comes from there cannot be dumped: the copy lacks its functions. Whether JAX has a cache is
    decided once for the process, so programs get keys here under which none is ever written.
    """
    with (
        config.compilation_cache_include_metadata_in_key(True),
        config.persistent_cache_min_compile_time_secs(math.inf),
    ):
        yield


def dump_executable(compiled: Any) -> tuple[Any, ...]:
    """A compiled program of positional arrays, in what can be pickled."""
    binary, _, tree = serialize_executable.serialize(compiled)
    # A structure of results is an example of them, since it cannot be pickled itself.
    return binary, len(compiled.in_avals[0]), jax.tree.unflatten(tree, range(tree.num_leaves))


def name_of_missing(value: Any) -> str | None:
    """The name in its module of equinox's mark for a field that is not there; None of all else.

    There is one such object in a process, and a structure that holds a copy of it unflattens to
    nothing, so that it has to be pickled by its name.
    """
    return "MISSING" if value is MISSING else None


def load_executable(binary: bytes, count: int, example: Any) -> Any:
    """A compiled program of `count` arrays, from what `dump_executable` returns."""
    _lapack.initialize()  # as tracing a call of it would
    with _without_messages():
        return serialize_executable.deserialize_and_load(
            binary,
            jax.tree.structure(((0,) * count, {})),
            jax.tree.structure(example),
            execution_devices=jax.local_devices()[:1],
        )


@contextlib.contextmanager
def _without_messages() -> Iterator[None]:
    """XLA writes nothing to the terminal inside: what it refuses, it raises."""
    if jax.__version_info__ >= _SILENT:
        yield
        return
    levels = logging_config._tf_cpp_map  # of messages that are shown, by the names of JAX
    utils.absl_set_min_log_level(levels["CRITICAL"])
    try:
        yield
    finally:
        # The level before is JAX's own setting, or the variable that XLA reads when it begins.
        given = os.environ.get("TF_CPP_MIN_LOG_LEVEL", "")
        level = int(given) if given.isdecimal() else levels["INFO"]
        utils.absl_set_min_log_level(levels.get(jax.config.values["jax_logging_level"], level))


def depends_on_first(function: Callable[..., Any], *args: Any) -> bool:
    """Whether the results of a function depend on its first argument."""
    # A function of its own: JAX would compare the arrays of a bound method.
    _, used = without_unused(jax.make_jaxpr(lambda *args: function(*args))(*args))
    return used[0]


def without_unused(closed: Any) -> tuple[Any, list[bool]]:
    """The equations of a closed program that its results need, and which arguments they use."""
    jaxpr, used = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars))
    return jaxpr, used


def make_module(kind: type[M], **fields: Any) -> M:
    """A module of equinox of all its fields, as unflattening one makes it.

    Calling its class takes ten times as long, 0.1 ms for what a simulation returns.
    """
    module = object.__new__(kind)
    vars(module).update(fields)
    return module


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


def bind(primitive: Any, arrays: list[Any], params: Mapping[str, Any]) -> Any:
    """The results of an operation with its parameters in a jaxpr, where functions are jaxprs."""
    given = primitive.get_bind_params(params)
    functions, named = given if isinstance(given, tuple) else ((), given)  # until JAX 0.9
    return primitive.bind(*functions, *arrays, **named)


def scan_counts(params: Mapping[str, Any]) -> tuple[int, int]:
    """How many arguments of a scan never change, and how many it carries: of its parameters."""
    if "num_consts" in params:
        return params["num_consts"], params["num_carry"]
    fixed, carried, _ = params["ft_in"].unpack()  # since JAX 0.12
    return len(fixed), len(carried)


def of_plain_operations(closed: Any) -> Any:
    """A closed jaxpr without primitives that stand for functions, such as that of a search.

    Since JAX 0.12 some stay in what is traced until JAX compiles it.
    """
    if not getattr(closed.jaxpr, "is_high", False):
        return closed
    return partial_eval.lower_jaxpr2(closed)


def scan_kind(solver: Any) -> Any:
    """The kind of loop over a Runge–Kutta method's stages.

    diffrax's adjoints set it in what they take for such a method, a wrapped one too.
    """
    return solver.scan_kind


def state_of_method(
    solver: diffrax.AbstractSolver[Any], term: Any, t0: Any, t1: Any, y0: Any, args: Any
) -> Any:
    """What a method keeps between its steps, before the first one of an ordinary equation.

    diffrax's Runge–Kutta methods ask the vector field for its shape, which is that of the state:
    to trace it for that takes as long as for a step.
    """
    # A method around another one is of its kind to diffrax, but may ask for a term of its own.
    wraps = isinstance(solver, diffrax.AbstractWrappedSolver)
    if isinstance(solver, diffrax.AbstractRungeKutta) and not wraps and not parts_of_term(term):
        term = diffrax.ODETerm(lambda t, y, args: y)
    return solver.init(term, t0, t1, y0, args)


def control_arguments(solver: diffrax.AbstractSolver[Any]) -> Any:
    """Return what a solver passes on to `contr` of its terms, as diffrax asks wrappers for it."""
    return solver.term_compatible_contr_kwargs


def forward_only(words: str, *values: jax.Array) -> tuple[jax.Array, ...]:
    """The same values; in reverse mode InputError with some words."""
    return tuple([_forward_only.bind(x, words=words) for x in values])


def _refuse_reverse(*_: Any, words: str) -> NoReturn:
    raise InputError(words)


def _refuse_linear(_: Any, x: Any, words: str) -> Any:
    """Refuse what is not known yet where JAX takes a program apart, as reverse mode does first."""
    if not x.is_known():
        raise InputError(words)
    # JAX has set the trace to that around the program.
    return _forward_only.bind(x.pval.get_known(), words=words)


_forward_only = Primitive("forward_only")
_forward_only.def_impl(lambda x, words: x)
_forward_only.def_abstract_eval(lambda x, words: x)
ad.deflinear2(_forward_only, _refuse_reverse)
partial_eval.custom_partial_eval_rules[_forward_only] = _refuse_linear
batching.defvectorized(_forward_only)
mlir.register_lowering(_forward_only, lambda ctx, x, words: [x])
