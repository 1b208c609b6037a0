"""How simulations are differentiated where their call does not say."""

import contextlib
import contextvars
from collections.abc import Iterator

import diffrax

_chosen = contextvars.ContextVar[diffrax.AbstractAdjoint | None]("adjoint", default=None)


def default_adjoint() -> diffrax.AbstractAdjoint:
    """Reverse mode with checkpoints, or what surrounds the call."""
    return _chosen.get() or diffrax.RecursiveCheckpointAdjoint()


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Inside, simulations without an `adjoint` of their own are differentiated forwards.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. What JAX has compiled outside keeps its own mode.
    """
    token = _chosen.set(diffrax.ForwardMode())
    try:
        yield
    finally:
        _chosen.reset(token)
