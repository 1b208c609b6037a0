"""Computations that JAX does not trace, wherever they are asked for."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import jax.numpy as jnp

from .compat import is_outermost

T = TypeVar("T")


def outside_of_traces(call: Callable[[], T]) -> T:
    """Evaluate a function without traced numbers at once, also where JAX traces."""
    if is_outermost():
        return call()
    double = jnp.result_type(float) == jnp.float64

    def alone() -> T:
        with jax.enable_x64(double):
            return call()

    # A thread of its own: JAX traces nothing there, whatever it traces here.
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(alone).result()
