"""Snapshots of a motion, weighted so that their singular values mean energy and time."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@runtime_checkable
class Motion(Protocol):
    """What a basis is made from; a Trajectory is one."""

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]
    metric: Float[Array, "n n"]
    labels: tuple[str, ...]


class Snapshots(NamedTuple):
    """S (q − q̄) √w and S v √w as columns, with Sᵀ S the metric and w trapezoidal time weights.

    The metric makes the singular values independent of units, the weights of the sample rate
    (they approximate the L² norm in time), the offset of where the mechanism stands.
    """

    positions: Float[Array, "n h"]
    velocities: Float[Array, "n h"]
    offset: Float[Array, " n"]
    root: Float[Array, "n n"]  # S, upper triangular
    weights: Float[Array, " h"]  # √w


def weigh(motion: Motion, offset: Any) -> Snapshots:
    """The weighted snapshots about `offset` (n,), the first configuration if that is None."""
    centre = motion.q[0] if offset is None else jnp.asarray(offset, motion.q.dtype)
    return _weigh(motion.t, motion.q, motion.v, motion.metric, centre)


@jax.jit
def _weigh(
    t: Float[Array, " h"],
    q: Float[Array, "h n"],
    v: Float[Array, "h n"],
    metric: Float[Array, "n n"],
    offset: Float[Array, " n"],
) -> Snapshots:
    step, none = jnp.diff(t), jnp.zeros(1, t.dtype)
    weights = jnp.sqrt(0.5 * (jnp.append(step, none) + jnp.append(none, step)))
    root = jnp.linalg.cholesky(metric).T
    positions, velocities = root @ (q - offset[None]).T, root @ v.T
    return Snapshots(positions * weights[None], velocities * weights[None], offset, root, weights)
