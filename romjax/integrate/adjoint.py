"""The way to differentiate simulations whose call does not name one."""

import contextlib
from collections.abc import Iterator

import diffrax

from ..compat import trace_context

_forwards = trace_context(False)


def default_adjoint() -> diffrax.AbstractAdjoint:
    """Forward mode inside of `forward_mode()`, reverse mode with checkpoints elsewhere."""
    return diffrax.ForwardMode() if _forwards.value else diffrax.RecursiveCheckpointAdjoint()


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Inside, simulations without an `adjoint` of their own are differentiated forwards.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. Functions that are jitted already follow the mode too.
    """
    with _forwards(True):
        yield
