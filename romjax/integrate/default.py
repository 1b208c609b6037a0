"""Choices that a simulation makes where the user makes none."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..system.base import AbstractSystem
from ..system.stabilization import Baumgarte


def default_stabilization(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    dt: Float[Array, ""] | None,
) -> Baumgarte | None:
    """Critical damping at the fastest rigid frequency ω: α = 2ω, β = ω².

    Faster stabilisation buys no accuracy: it limits the step and lowers the order of explicit
    methods, so ω dt stays below 0.1. ω is at least one turn in the simulated time, so that a
    mechanism that nothing drives at the start is stabilised too.
    """
    if system.m == 0:
        return None
    omega = jnp.maximum(system.rigid_frequency(ts[0], q, v), 2 * jnp.pi / (ts[-1] - ts[0]))
    if dt is not None:
        omega = jnp.minimum(omega, 0.1 / dt)
    return Baumgarte.critical(jax.lax.stop_gradient(omega))
