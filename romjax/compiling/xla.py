"""Settings of XLA, the compiler behind JAX, that suit small mechanisms on a CPU."""

import contextlib
import contextvars
import functools
import os
import types
import warnings
from collections.abc import Callable, Iterator
from typing import Any, overload

import equinox as eqx
import jax
import numpy as np

from ..common import compat
from . import functions

_has_options = contextvars.ContextVar("_has_options", default=False)
# Whether it was told that a program lacks the options.
_told = list[bool]()
# Derivatives that JAX took of known numbers, in no program; from so many on, a program pays.
_taken, _MANY = list[bool](), 5


@functools.cache
def known_options() -> dict[str, Any] | None:
    """The options of the compiler; None where there are none, on other devices than a CPU."""
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda x: x, compiler_options=compat.compiler_options())(np.zeros(1))
    except jax.errors.JaxRuntimeError as error:
        warnings.warn(
            f"romjax does not know the compiler of JAX {jax.__version__} ({error}): simulations "
            "will take longer to compile and to run.",
            stacklevel=2,
        )
        return None
    return compat.compiler_options()


@contextlib.contextmanager
def tracing_with_options() -> Iterator[None]:
    """Mark all that is traced inside as part of a program that has the compiler's options."""
    token = _has_options.set(True)
    try:
        yield
    finally:
        _has_options.reset(token)


def tell_of_jit() -> None:
    """Warn, once in a process, where JAX traces a run for a program that lacks the options."""
    if _told or compat.is_outermost() or _has_options.get():
        return
    if compat.is_differentiating():
        # A few such derivatives know the numbers that the method is chosen by.
        _taken.append(True)
        if len(_taken) < _MANY:
            return
    flags = os.environ.get("XLA_FLAGS", "").split()
    if jax.default_backend() != "cpu" or any(x in flags for x in compat.compiler_flags()):
        return
    _told.append(True)
    warnings.warn(
        "simulate: this run is part of a function that jax.jit or another transformation of JAX "
        "compiles without the options for small mechanisms, so that it takes longer on a CPU, "
        "with some versions of JAX several times as long: compile it by romjax.jit instead, around "
        "all transformations; or, where the call of jax.jit is not yours, call "
        "romjax.speed_up_xla() right after importing romjax.",
        stacklevel=3,
    )


def _split(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of what JAX traces that computes as functions of XLA what can be one."""

    @functools.wraps(function)
    def split(*args: Any, **kwargs: Any) -> Any:
        leaves, tree = jax.tree.flatten((args, kwargs))
        static: Any = None

        # JAX names the user's function in its messages.
        @functools.wraps(function)
        def flat(*arrays: Any) -> Any:
            nonlocal static
            given = iter(arrays)
            own = [next(given) if isinstance(x, jax.core.Tracer) else x for x in leaves]
            args, kwargs = jax.tree.unflatten(tree, own)
            results, static = eqx.partition(function(*args, **kwargs), eqx.is_array)
            return results

        arrays = [x for x in leaves if isinstance(x, jax.core.Tracer)]
        limits = functions.MOST, functions.TOGETHER_IN_JIT
        return eqx.combine(functions.split(flat, *limits, *arrays), static)

    return split


class Jitted:
    """A function that `jit` compiles, which is called as the function is. `how`: by which one."""

    def __init__(self, function: Callable[..., Any], settings: dict[str, Any], how: Any = jax.jit):
        # Its attributes stay its own: transformations of JAX copy those of what they transform.
        functools.update_wrapper(self, function, updated=())
        self._function, self._settings, self._how = function, settings, how
        # A program inside of another one is compiled by the options of that one.
        inside = {name: x for name, x in settings.items() if name != "compiler_options"}
        self._inside = how(function, **inside)
        # Forms of arguments for which a call failed although XLA compiles their program.
        self._compiled = set[Any]()

    def _with_options(self, function: Callable[..., Any]) -> Any:
        # Asking for the options sets JAX up, which the first call may do, but no decorator.
        given = self._settings.get("compiler_options") or {}
        options = {**(known_options() or {}), **given}
        return self._how(function, **{**self._settings, "compiler_options": options})

    @functools.cached_property
    def _plain(self) -> Any:
        return self._with_options(self._function)

    @functools.cached_property
    def _outermost(self) -> Any:
        # A function of XLA stands on one device.
        several = jax.local_device_count() > 1
        if known_options() is None or several or not compat.compiles_functions():
            return self._plain
        return self._with_options(_split(self._function))

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        config: Any = jax.config
        if not compat.is_outermost() or config.jax_disable_jit:
            return self._inside(*args, **kwargs)
        with tracing_with_options():
            if config.jax_debug_nans or config.jax_debug_infs:
                # JAX then looks for the operation, which it knows by itself only.
                return self._plain(*args, **kwargs)
            try:
                return self._outermost(*args, **kwargs)
            except jax.errors.JaxRuntimeError:
                if self._outermost is self._plain or self._compiles(*args, **kwargs):
                    raise
            # Not all that consists of known primitives can be compiled as a function.
            self._outermost = self._plain
            return self._plain(*args, **kwargs)

    def _compiles(self, *args: Any, **kwargs: Any) -> bool:
        """Whether XLA compiles all that is split, so that an error is one of the run."""
        leaves, tree = jax.tree.flatten((args, kwargs))
        arrays = jax.Array, np.ndarray
        form = [(x.shape, x.dtype) if isinstance(x, arrays) else (type(x), x) for x in leaves]
        key = tree, tuple(form), compat.trace_settings()
        if key not in self._compiled:
            try:
                self._outermost.lower(*args, **kwargs).compile()
            except jax.errors.JaxRuntimeError:
                return False
            self._compiled.add(key)
        return True

    def __get__(self, owner: Any, kind: Any = None) -> Any:
        """Bind a method to its object."""
        return self if owner is None else types.MethodType(self, owner)

    def lower(self, *args: Any, **kwargs: Any) -> Any:
        """Trace and lower the function for `.compile()`, as `jax.jit` does."""
        with tracing_with_options():
            return self._outermost.lower(*args, **kwargs)

    def trace(self, *args: Any, **kwargs: Any) -> Any:
        """Trace the function to a jaxpr for `.lower()`, as `jax.jit` does."""
        with tracing_with_options():
            return self._outermost.trace(*args, **kwargs)

    def eval_shape(self, *args: Any, **kwargs: Any) -> Any:
        """Return the shapes and types of the results, as `jax.jit` does."""
        with tracing_with_options():
            return self._inside.eval_shape(*args, **kwargs)

    def clear_cache(self) -> None:
        """Forget the compiled programs, as `jax.jit` does."""
        for program in (self._inside, self._plain, self._outermost):
            program.clear_cache()


@overload
def jit(function: Callable[..., Any], /, **settings: Any) -> Jitted: ...


@overload
def jit(**settings: Any) -> Callable[[Callable[..., Any]], Jitted]: ...


def jit(function: Callable[..., Any] | None = None, /, **settings: Any) -> Any:
    """`jax.jit`, compiled for small mechanisms on a CPU.

    For functions of your own with runs in them, and for their batches and derivatives: loops and
    calls become functions, where JAX starts a kernel for each operation, so that one run and its
    derivative take less time than in `jax.jit` (`benchmarks/gradients.txt`), and
    `rj.jit(jax.vmap(run))` makes more runs per second than `jax.jit(jax.vmap(run))`; how many more
    depends on the version of JAX (`benchmarks/batches.txt`). Batches of runs by explicit methods
    have their lanes last in memory, so that a processor computes several at once. What works on
    complex numbers, keys of random numbers or large arrays stays as it is, and so do all programs
    where there are several devices, or JAX 0.11 or later. A simulation outside of a function of
    your own needs none of it.

    Only the outermost program of a call has options: put this around `vmap`, `grad` and `jacfwd`,
    not within. Inside of another program or transformation, on other devices than a CPU, and where
    the options are not known, it is `jax.jit`. What it compiles goes to JAX's own cache on disk, if
    that is set up, and not to romjax's.

    **Arguments:**

    - `function`: as `jax.jit` takes it; leave it out to decorate with settings,
      `@rj.jit(static_argnames="method")`.
    - `settings`: keywords of `jax.jit`, such as `static_argnames` and `donate_argnums`; of
      `compiler_options`, those that are given count before romjax's.

    Returns what is called like the function, with `lower`, `trace`, `eval_shape` and `clear_cache`.
    Raises what `jax.jit` raises.
    """
    if function is None:
        return functools.partial(jit, **settings)
    return Jitted(function, settings)


def filter_jit(function: Callable[..., Any]) -> Any:
    """Compile a function as `jit` does, but trace only the arrays among its arguments (Equinox)."""
    return Jitted(function, {}, eqx.filter_jit)


def speed_up_xla() -> None:
    """Make simulations faster on a CPU in programs that others compile.

    It is for runs inside of a `jax.jit` that is not yours, such as that of a sampler: your own are
    faster by `jit`, and a simulation outside of both is anyway.
    Programs compile in 0.7 of the time, but for gradients in reverse mode, which take two to six
    times as long.

    Adds flags to the environment variable XLA_FLAGS, which XLA reads at JAX's first computation,
    for the whole process; call it before. Nothing changes on other devices.

    Warns if JAX has computed something already, since the flags then have no effect, and where it
    is not tested that this version of JAX knows them: XLA ends the process at one that it does not.
    """
    if not compat.compiler_flags():
        warnings.warn(
            f"speed_up_xla: the flags of JAX {jax.__version__} are not known, so none is set.",
            stacklevel=2,
        )
        return
    before = os.environ.get("XLA_FLAGS", "").split()
    missing = [flag for flag in compat.compiler_flags() if flag not in before]
    if missing and compat.compiler_is_set_up():
        warnings.warn(
            "speed_up_xla: JAX has computed something already, so its compiler is set up and this "
            "has no effect; call it right after importing romjax.",
            stacklevel=2,
        )
        return
    os.environ["XLA_FLAGS"] = " ".join(before + missing)
