"""The way to differentiate simulations whose call does not name one."""

import contextlib
from collections.abc import Iterator
from typing import Any

import diffrax

from ..compat import trace_context

_forwards = trace_context(False)
_not_at_all = trace_context(False)


def default_adjoint(solver: diffrax.AbstractSolver[Any]) -> diffrax.AbstractAdjoint | None:
    """Forward mode inside of `forward_mode()`, reverse mode with checkpoints elsewhere; None inside
    of `no_derivatives()`, but for solvers with a root finder, whose loops need an adjoint.
    """
    if _not_at_all.value:
        implicit = isinstance(solver, diffrax.AbstractImplicitSolver)
        return diffrax.ForwardMode() if implicit else None
    return diffrax.ForwardMode() if _forwards.value else diffrax.RecursiveCheckpointAdjoint()


@contextlib.contextmanager
def no_derivatives() -> Iterator[None]:
    """Inside, simulations that are part of a program are those that stand alone: nobody may
    differentiate them.
    """
    with _not_at_all(True):
        yield


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Inside, simulations without an `adjoint` of their own are differentiated forwards.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. Functions that are jitted already follow the mode too.
    """
    with _forwards(True):
        yield
