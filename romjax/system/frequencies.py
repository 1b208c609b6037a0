"""How fast a system is: what the choice of a method and of a stabilisation needs."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..linalg import quaternions
from .base import AbstractSystem
from .dynamics import solve
from .stabilization import Baumgarte

# Of the power iteration; the estimate settles a choice, not a result.
_ITERATIONS = 12


class Frequencies(NamedTuple):
    """The fastest frequencies of a system at one state [rad/s]."""

    rigid: Float[Array, ""]  # fastest rigid-body frequency
    fastest: Float[Array, ""]  # fastest frequency or rate of decay of all
    spin: Float[Array, ""]  # fastest angular velocity of a body in space


def frequencies(
    system: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
) -> Frequencies:
    """The fastest frequencies at a state.

    Of a reduced system with constraints, the rigid one is that of the full system: it sets the
    stabilisation, and reduced coordinates know no bodies.
    """
    rigid, fastest = _estimate(system, t, q, v)
    starts = system.full.structure.quaternions
    constrained = system.m > 0 and system.full is not system
    if not constrained and not starts:
        return Frequencies(rigid, fastest, jnp.zeros_like(fastest))
    state = system.state(t, q, v)
    if constrained:
        rigid, _ = _estimate(system.full, t, state.q, state.v)
    return Frequencies(rigid, fastest, _spin(starts, state.q, state.v))


def _spin(
    starts: tuple[int, ...], q: Float[Array, " N"], v: Float[Array, " N"]
) -> Float[Array, ""]:
    """The fastest angular velocity [rad/s], 2 |ṗ| / |p| where |p| is constant."""
    if not starts:
        return jnp.zeros((), q.dtype)
    columns = quaternions.columns(starts)
    squared = jnp.sum(v[columns] ** 2, axis=1) / jnp.sum(q[columns] ** 2, axis=1)
    return 2 * jnp.sqrt(jnp.max(squared))


def _estimate(
    system: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The fastest frequency of rigid motion, and that of all [rad/s].

    By power iteration with products only, in the metric of M.

    ω² = |∂a/∂q| sees springs, flexible modes, gravity on hinged bodies and rotation; the rate
    |∂a/∂v| sees dampers. Three directions are iterated at once: among the rigid coordinates for
    ∂a/∂q, among all for ∂a/∂q, and among all for ∂a/∂v.
    """
    # Difference quotients: the derivative would double the program for a rough number.
    step = jnp.sqrt(jnp.finfo(q.dtype).eps)
    among = jnp.stack([jnp.array(system.structure.rigid), *[jnp.ones(system.n, bool)] * 2])
    t, state = jnp.asarray(t, q.dtype), system.state(t, q, v)
    # Zero stabilisation instead of none: the trace of the acceleration then serves the steps too.
    unstabilized = Baumgarte(jnp.zeros((), q.dtype), jnp.zeros((), q.dtype)) if system.m else None

    def sizes(x: Float[Array, "three n"]) -> Float[Array, " three"]:
        return jnp.sqrt(jnp.sum(x * state.apply_mass(x.T).T, axis=1))

    def push(x: Array, _: None) -> tuple[Array, Array]:
        # The third row is the state itself, from which the quotients are taken.
        positions = jnp.concatenate([x[:2], jnp.zeros_like(x[:2])])
        rates = jnp.concatenate([jnp.zeros_like(x), x[2:]])
        # A loop, not a batch: as a batch, the acceleration would be traced and compiled once more.
        pushed = jax.lax.map(
            lambda x: solve(system, t, q + step * x[0], v + step * x[1], unstabilized).acceleration,
            (positions, rates),
        )
        change = jnp.where(among, (pushed[np.array([0, 1, 3])] - pushed[2][None]) / step, 0)
        size = sizes(change)
        return change / jnp.where(size > 0, size, 1)[:, None], size

    # No symmetric direction, so that no mode of a symmetric mechanism is missed.
    x = jnp.where(among, jnp.cos(1.0 + jnp.arange(system.n, dtype=q.dtype) ** 1.5)[None], 0)
    size = sizes(x)
    start = x / jnp.where(size > 0, size, 1)[:, None]
    _, stretches = jax.lax.scan(push, start, None, length=_ITERATIONS)
    # The largest stretch met, not the last: a level pendulum's ∂a/∂q is nilpotent.
    rigid, all_, rate = jnp.max(stretches, axis=0)
    return jnp.sqrt(rigid), jnp.maximum(jnp.sqrt(all_), rate)
