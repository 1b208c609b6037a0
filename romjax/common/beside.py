"""Work on another core: a function in a process of its own."""

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@contextlib.contextmanager
def beside(
    function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> Iterator[Callable[[], T]]:
    """Begin a function of a module in another process; yields what waits for its result.

    Ctrl-C is for this process alone; an exception here ends the other one.
    """
    others = {*multiprocessing.active_children()}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=_ignore_interrupts) as pool:
        begun = pool.submit(function, *args, **kwargs)
        try:
            yield begun.result
        except BaseException:
            # It would go on to its end, and this process wait for it.
            for process in {*multiprocessing.active_children()} - others:
                process.terminate()
            raise


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
