"""How simulations are differentiated where their call does not say."""

import contextlib
from collections.abc import Iterator

import diffrax
import jax

# Part of the key of JAX's caches: a function that is compiled is traced again in another mode.
_forwards = jax.make_user_context(False)


def default_adjoint() -> diffrax.AbstractAdjoint:
    """Reverse mode with checkpoints, or what surrounds the call."""
    return diffrax.ForwardMode() if _forwards.value else diffrax.RecursiveCheckpointAdjoint()


@contextlib.contextmanager
def forward_mode() -> Iterator[None]:
    """Inside, simulations without an `adjoint` of their own are differentiated forwards.

    With `jax.jvp`, `jax.jacfwd`, `jax.linearize`; for functions of a few parameters, which then
    need no `adjoint=diffrax.ForwardMode()`. Functions that are jitted already follow the mode too.
    """
    with _forwards(True):
        yield
