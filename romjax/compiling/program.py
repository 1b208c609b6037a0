"""Compiled programs: how everything that romjax runs by itself is compiled.

Mechanisms are small: XLA's way of running a program on a CPU, a list of kernels that are started
one by one, takes longer to start each kernel than to run it. Two settings, program by program,
change that and nothing else in the process:

- Options of the compiler: fusions are compiled by the older emitter, which takes half the time,
  sums over small axes stay in the loops around them, and products on their thread.
- A call that carries the attribute `xla_cpu_small_call` becomes one function instead of kernels. It
  may contain no call of a library (LAPACK, a callback to Python) and no large product; loops
  around such calls stay loops, and what is inside of them and free of calls becomes a function.
  From JAX 0.11 on, XLA compiles no such function that holds fusions, and programs stay as they are.

Both hold only for a program that nothing surrounds: within a transformation of JAX (`jit`, `vmap`,
`grad`) of the user, the function is part of the user's program.
"""

import dataclasses
import functools
import gc
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import numpy as np

from ..common import compat
from ..common.identity_cache import IdentityCache
from . import functions, program_cache, room, xla

F = TypeVar("F", bound=Callable[..., Any])
# How often a program runs.
Runs = Literal["one", "some", "many"]

# Programs that are remembered, of one function.
_PROGRAMS = 256


class Program:
    """A function of pytrees, compiled for each structure of its arguments.

    `runs`: how many times it runs, which decides how much time its compilation is worth.

    Arrays are traced; everything else in the arguments is static, and must be hashable. Returns
    pytrees of arrays only.
    """

    def __init__(self, function: Callable[..., Any], runs: Runs = "some"):
        functools.update_wrapper(self, function)
        self._function, self._runs = function, runs
        self._inside = eqx.filter_jit(function)
        self._compiled = functools.lru_cache(_PROGRAMS)(self._compile)
        room.add(self)

    def __call__(self, *args: Any) -> Any:
        if not compat.is_outermost():
            return self._inside(*args)
        if jax.config.jax_disable_jit:  # type: ignore[attr-defined]
            # This lets one look at numbers on the way, operation by operation.
            return self._function(*args)
        compiled, arrays = self._of(args)
        return compiled(*arrays)

    def forget(self) -> None:
        """Forget what is compiled."""
        self._compiled.cache_clear()

    def compiled(self, *args: Any) -> Any:
        """Return the compiled program for these arguments, a function of a list of their arrays."""
        return self._of(args)[0]

    def _of(self, args: tuple[Any, ...]) -> tuple[Any, list[Any]]:
        parts = [_taken_apart(arg) for arg in args]
        kinds = tuple([kind for kind, _ in parts])
        arrays = [x for _, own in parts for x in own]
        return self._compiled(kinds, compat.trace_settings()), arrays

    def _compile(self, kinds: tuple["_Kind", ...], settings: Any) -> Any:
        room.make_room()

        def flat(*arrays: Any) -> Any:
            given = iter(arrays)
            return self._function(*[kind.joined(given) for kind in kinds])

        forms = [form for kind in kinds for form in kind.forms]
        options = xla.known_options()
        if options is None:
            return _lower(flat, forms, {}).compile()
        key = program_cache.key_of_call(self._function, kinds, settings)
        stored = program_cache.load_call(key)
        if stored is not None:
            return stored
        if self._runs == "one":
            merged = functools.partial(functions.merge, flat)
            return _read_or_compile(merged, forms, options | compat.QUICK, key)
        if not compat.compiles_functions():
            return _read_or_compile(flat, forms, options, key)
        try:
            most = functions.MOST if self._runs == "some" else functions.MOST_OFTEN
            split = functools.partial(functions.split, flat, most, functions.TOGETHER)
            return _read_or_compile(split, forms, options, key)
        except jax.errors.JaxRuntimeError:
            # Not all that consists of known primitives can be compiled as a function.
            return _read_or_compile(flat, forms, options, key)


def _read_or_compile(
    function: Callable[..., Any], forms: Sequence[Any], options: dict[str, Any], key: str | None
) -> Any:
    """A function of arrays of these forms, compiled, or read from disk.

    `key`: of the call, under which it was looked for before it was traced; None if it has none.
    """
    lowered = _lower(function, forms, options)
    text = program_cache.key_of_text(lowered.as_text(), lowered.out_tree, options)
    if text is None or not program_cache.keeps(text):
        return lowered.compile()
    compiled = program_cache.load(text)
    if compiled is None:
        with compat.without_cache_of_jax():
            compiled = lowered.compile()
        program_cache.store(text, compiled)
    program_cache.store_call(key, text)
    return compiled


def _without_collecting(function: F) -> F:
    """`function`, with Python's collector of cyclic garbage at rest.

    It would walk all of a trace again and again while that grows, a tenth of the time it takes.
    """

    @functools.wraps(function)
    def collected_later(*args: Any) -> Any:
        if not gc.isenabled():
            return function(*args)
        gc.disable()
        try:
            return function(*args)
        finally:
            gc.enable()

    return cast(F, collected_later)


@_without_collecting
def _lower(function: Callable[..., Any], forms: Sequence[Any], options: dict[str, Any]) -> Any:
    structs = [jax.ShapeDtypeStruct(shape, dtype, sharding=at) for shape, dtype, at in forms]
    # All arguments are kept, so that the text says which of them are used.
    with xla.tracing_with_options():
        return jax.jit(function, keep_unused=True, compiler_options=options).lower(*structs)


def program(function: F) -> F:
    """`function` as a `Program`."""
    return cast(F, Program(function))


def program_once(function: F) -> F:
    """`function` as a `Program` that runs once or twice: compiled without optimisation."""
    return cast(F, Program(function, "one"))


def program_often(function: F) -> F:
    """`function` as a `Program` that runs hundreds of times: compiled longer, to run faster."""
    return cast(F, Program(function, "many"))


@dataclasses.dataclass(frozen=True, eq=False)
class _Kind:
    """The part of an argument that a program is compiled for: all but its numbers.

    - `tree`: its structure; `static`: its leaves, None for an array with entries; `forms`: of
      these arrays.
    """

    tree: Any
    static: tuple[Any, ...]
    forms: tuple[Any, ...]

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, _Kind) and self._key == other._key)

    def __hash__(self) -> int:
        return self._hash

    @property
    def _key(self) -> tuple[Any, ...]:
        return self.tree, self.static, self.forms

    @functools.cached_property
    def _hash(self) -> int:
        return hash(self._key)

    def joined(self, arrays: Iterator[Any]) -> Any:
        """An argument of this kind, of the next arrays."""
        leaves = [next(arrays) if x is None else _restore(x) for x in self.static]
        return jax.tree.unflatten(self.tree, leaves)


_parts = IdentityCache()


def _taken_apart(arg: Any) -> tuple[_Kind, list[Any]]:
    """The kind of an argument and its arrays, which are remembered with a module."""
    if isinstance(arg, jax.Array | np.ndarray) and arg.size:
        return _kind_of_array(*_form(arg)), [arg]
    known: tuple[_Kind, list[Any]] | None = _parts.get(arg)
    if known is not None:
        return known
    leaves, tree = jax.tree.flatten(arg)
    static = tuple([_static(x) for x in leaves])
    arrays = [x for x, value in zip(leaves, static, strict=True) if value is None]
    kind = _Kind(tree, static, tuple([_form(x) for x in arrays]))
    return _parts.put(arg, (kind, arrays)) if isinstance(arg, eqx.Module) else (kind, arrays)


@functools.lru_cache
def _kind_of_array(shape: tuple[int, ...], dtype: Any, sharding: Any) -> _Kind:
    """The kind of an argument that is a single array."""
    return _Kind(jax.tree.structure(0), (None,), ((shape, dtype, sharding),))


class _Empty(NamedTuple):
    """An array without entries."""

    shape: tuple[int, ...]
    dtype: np.dtype


def _static(x: Any) -> Any:
    """Return a leaf that is known before the program runs, or None for an array with entries."""
    if isinstance(x, jax.Array | np.ndarray):
        return None if x.size else _Empty(x.shape, x.dtype)
    return x


def _form(x: Any) -> tuple[Any, ...]:
    """Return the shape and the type of an array, and its device if there are several."""
    elsewhere = _has_several_devices() and isinstance(x, jax.Array) and x.committed
    return x.shape, x.dtype, x.sharding if elsewhere else None


@functools.cache
def _has_several_devices() -> bool:
    return jax.local_device_count() > 1


def _restore(x: Any) -> Any:
    return np.zeros(x.shape, x.dtype) if isinstance(x, _Empty) else x
