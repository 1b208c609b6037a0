"""The way to differentiate simulations whose call does not name one."""

import contextlib
from collections.abc import Iterator
from typing import Any

import diffrax

from ..compat import trace_context

_forwards = trace_context(False)


def default_adjoint(solver: diffrax.AbstractSolver[Any]) -> diffrax.AbstractAdjoint | None:
    """Forward mode inside of `forward_mode()`, elsewhere reverse mode: romjax's own (None), but for
    solvers with a root finder, whose loops need an adjoint of diffrax.
    """
    if _forwards.value:
        return diffrax.ForwardMode()
    implicit = isinstance(solver, diffrax.AbstractImplicitSolver)
    return diffrax.RecursiveCheckpointAdjoint() if implicit else None


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Inside, simulations without an `adjoint` of their own are differentiated forwards.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. Functions that are jitted already follow the mode too.
    """
    with _forwards(True):
        yield
