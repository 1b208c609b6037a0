"""The time of calls."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

T = TypeVar("T")
# [s] What takes shorter is repeated until it takes as long, which clocks and other work of the
# machine blur less; more rounds of short turns tell more than longer turns.
_SHORTEST = 0.01
# On a machine with many more programs than cores, the worst of a dozen ratios comes again within a
# quarter from twenty rounds.
_ROUNDS = 3, 20
# No more rounds are needed after more than so many, once the standard errors of the medians are at
# most this share of them, and were a round before: a few values are near each other by chance, five
# with noise of a tenth in one case of five. The worst of a dozen models then differs by a seventh
# between two tables, two and a half times the standard error of a difference.
_ENOUGH, _KNOWN = 5, 0.04


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """Return what `call` does, and how long it takes until all its arrays are there [s]."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - begin


def worked(call: Callable[[], T]) -> tuple[T, float]:
    """Return what `call` does, and how long is worked on it, as `_clock` tells [s]."""
    clock = _clock()
    begin = clock()
    result = jax.block_until_ready(call())
    return result, clock() - begin


class Alternating(NamedTuple):
    """Times of calls [s], and how many times as fast as the first each is, (calls,)."""

    times: np.ndarray
    speed_ups: np.ndarray


def alternating(calls: Sequence[Callable[[], Any]], spend: float) -> Alternating:
    """Medians of rounds in which all calls take turns, for `spend` [s] in all about.

    A busy machine slows down a whole round, and not the ratios within it. On a CPU the time is that
    of the processor, since what else it does may take it away for longer than a short call lasts;
    `spend` is too, so that there are as many rounds when it is busy. Medians of 20 rounds come
    again within a quarter there, and least times do not. A quiet machine needs a few rounds for as
    much: less is spent where they agree.
    """
    once = [min(_own_time(call, 1), _own_time(call, 1)) for call in calls]
    counts = [max(1, round(_SHORTEST / taken)) for taken in once]
    total = sum(count * taken for count, taken in zip(counts, once, strict=True))
    times = np.empty((0, len(calls)))
    for _ in range(int(np.clip(spend / total, *_ROUNDS))):
        turns = [_own_time(call, count) for call, count in zip(calls, counts, strict=True)]
        times = np.append(times, [turns], axis=0)
        if len(times) > _ENOUGH and _are_known(times) and _are_known(times[:-1]):
            break
    return Alternating(np.median(times, axis=0), np.median(times[:, :1] / times, axis=0))


def _are_known(times: np.ndarray) -> bool:
    """Whether medians of `times` (rounds, calls) and of their ratios have small standard errors.

    They are those of normally distributed values, whose spread their quartiles tell, so that one
    round that was disturbed counts little.
    """
    values = np.concatenate([times, times[:, :1] / times], axis=1)
    low, median, high = np.percentile(values, [25, 50, 75], axis=0)
    # The quartiles of a normal distribution are 1.349 standard deviations apart, and its median, of
    # n values, has the standard error √(π / 2n) of them.
    deviation = (high - low) / 1.349
    errors = np.sqrt(np.pi / 2 / len(values)) * deviation
    return bool(np.all(errors <= _KNOWN * median))


def _clock() -> Callable[[], float]:
    """The time of the processor, without other work of the machine [s]; with another device than
    the CPU that would leave out what the device does, and it is the time that passes.
    """
    return time.process_time if jax.default_backend() == "cpu" else time.perf_counter


def _own_time(call: Callable[[], Any], count: int) -> float:
    """The time of a call [s], on average over `count` of them."""
    clock = _clock()
    begin = clock()
    for _ in range(count):
        jax.block_until_ready(call())
    return (clock() - begin) / count
