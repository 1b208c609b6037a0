"""The way to differentiate simulations whose call does not name one."""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import diffrax

from ..common.compat import trace_context

_forwards = trace_context(False)


def is_forward(adjoint: diffrax.AbstractAdjoint | None) -> bool:
    """Whether derivatives are taken in forward mode: as it is given, or inside `forward_mode()`."""
    return isinstance(adjoint, diffrax.ForwardMode) or (adjoint is None and _forwards.value)


def has_root_finder(solver: diffrax.AbstractSolver[Any]) -> bool:
    """Whether each step of this solver is an iteration."""
    return _has_root_finder(type(solver))


@functools.cache
def _has_root_finder(kind: type) -> bool:
    # Diffrax answers questions about its classes in Python, in 4 µs.
    return issubclass(kind, diffrax.AbstractImplicitSolver)


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Differentiate simulations without an `adjoint` of their own forwards inside this context.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. Functions that are jitted already follow the mode too.
    """
    with _forwards(True):
        yield
