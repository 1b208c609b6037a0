"""Times of several programs on one machine."""

import math
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from tqdm import tqdm

# [s] A shorter call notices caches that another program has used, and for so long.
SHORT, WARM = 0.1, 0.02


class Timed(NamedTuple):
    """Times of a call [s], and what it returned."""

    result: Any
    least: float
    median: float = math.nan
    first: float = math.nan  # of the call that does not count: it may compile


def clocked(call: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> Timed:
    """One call; of a short one the last of several, so that what ran before does not count.

    Where setting up is none of the work, a call clocks itself and returns `Timed`.
    """
    begun, count = time.perf_counter(), 0
    while count < 2 or time.perf_counter() - begun < WARM:
        start, count = clock(), count + 1
        result = jax.block_until_ready(call())
        taken = clock() - start
        if taken > SHORT:
            break
    return result if isinstance(result, Timed) else Timed(result, taken)


def least(
    calls: Sequence[Callable[[], Any]],
    repeats: int,
    slow: float = math.inf,
    name: str = "",
    clock: Callable[[], float] = time.perf_counter,
) -> list[Timed]:
    """Interleaved calls, in rounds, after a first call of each that does not count.

    What takes longer than `slow` [s] is measured once. `name` stands before the bar of progress.
    """
    times: list[list[float]] = [[] for _ in calls]
    results: list[Any] = [None] * len(calls)
    # No bar where nobody looks.
    for _ in tqdm(range(repeats + 1), name, leave=False, disable=None):
        for i, call in enumerate(calls):
            if times[i][1:] and times[i][-1] > slow:
                continue
            results[i], taken, *_ = clocked(call, clock)
            times[i].append(taken)
    return [
        Timed(result, min(taken[1:]), statistics.median(taken[1:]), taken[0])
        for result, taken in zip(results, times, strict=True)
    ]
