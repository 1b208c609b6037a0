"""Work on another core: a function in a process of its own."""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import ParamSpec, TypeVar

import jax

P = ParamSpec("P")
T = TypeVar("T")


@contextlib.contextmanager
def beside(
    function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> Iterator[Callable[[], T]]:
    """Begin a function of a module in another process; yields what waits for its result.

    Ctrl-C is for this process alone; where the context is left, the other one ends. With another
    device than the CPU the function is called here, when it is waited for, since each process of
    JAX takes most of the memory of a GPU.

    What waits raises ChildProcessError where the other process was ended, and else what the
    function does.
    """
    if jax.default_backend() != "cpu":
        yield lambda: function(*args, **kwargs)
        return
    others = {*multiprocessing.active_children()}
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        with _ignoring_interrupts():
            begun = pool.submit(function, *args, **kwargs)

        def result() -> T:
            try:
                return begun.result()
            except BrokenProcessPool as error:
                raise ChildProcessError(
                    "the process beside this one was ended by the system, or by somebody; if "
                    "memory is short, end other programs, and begin again."
                ) from error

        try:
            yield result
        finally:
            # It would go on to its end, and this process wait for it.
            if not begun.done():
                for process in {*multiprocessing.active_children()} - others:
                    process.terminate()


@contextlib.contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Processes that begin in here ignore Ctrl-C from their first moment, as they inherit it."""
    if threading.current_thread() is not threading.main_thread():  # only that one may set it
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
