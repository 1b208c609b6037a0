"""Work on another core: functions in a process of their own."""

import contextlib
import functools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, ParamSpec, Protocol, TypeVar, runtime_checkable

import jax

P = ParamSpec("P")
T = TypeVar("T")


@runtime_checkable
class Begin(Protocol):
    """Begins a function of a module elsewhere; returns what waits for its result."""

    def __call__(
        self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> Callable[[], T]: ...


def later(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Callable[[], T]:
    """Begins a function in this process, when its result is waited for."""
    return functools.partial(function, *args, **kwargs)


@contextlib.contextmanager
def beside() -> Iterator[Begin]:
    """Work in another process, one function after the other; yields what begins them.

    Ctrl-C is for this process alone; where the context is left, the other one ends, as it does
    where this one is killed. With another device than the CPU functions are called here, when they
    are waited for, since each process of JAX takes most of the memory of a GPU.

    What waits raises ChildProcessError where the other process was ended, and else what the
    function does.
    """
    if jax.default_backend() != "cpu":
        yield later
        return
    others, begun = {*multiprocessing.active_children()}, list[Future[Any]]()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=_end_with_parent) as pool:

        def begin(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Callable[[], T]:
            with _ignoring_interrupts(), _told():
                own = pool.submit(function, *args, **kwargs)
            begun.append(own)

            def result() -> T:
                with _told():
                    return own.result()

            return result

        try:
            yield begin
        finally:
            # It would go on to its end, and this process wait for it.
            if not all(one.done() for one in begun):
                for process in {*multiprocessing.active_children()} - others:
                    process.terminate()


def _end_with_parent() -> None:
    """End this process as soon as the one that began it is no more, however that has ended: by
    itself it would wait for work for ever, with the output of the other open.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except BrokenProcessPool as error:
        raise ChildProcessError(
            "the process beside this one was ended by the system, or by somebody; if memory is "
            "short, end other programs, and begin again."
        ) from error


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
