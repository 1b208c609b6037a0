"""The time of a call."""

import time
from collections.abc import Callable
from typing import TypeVar

import jax

T = TypeVar("T")


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What `call` returns, and how long it takes until all its arrays are there [s]."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - begin
