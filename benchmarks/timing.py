"""Times of several programs on one machine."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
from tqdm import tqdm


def least(calls: Sequence[Callable[[], Any]], repeats: int, slow: float = math.inf) -> list[float]:
    """The least of interleaved times of each [s], after a first call that does not count.

    What takes longer than `slow` [s] is measured once.
    """
    times: list[list[float]] = [[] for _ in calls]
    for _ in tqdm(range(repeats + 1), leave=False):
        for call, taken in zip(calls, times, strict=True):
            if taken[1:] and taken[-1] > slow:
                continue
            start = time.perf_counter()
            jax.block_until_ready(call())
            taken.append(time.perf_counter() - start)
    return [min(taken[1:]) for taken in times]
