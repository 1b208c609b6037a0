"""Snapshots of a motion, weighted so that their singular values mean energy and time."""

from typing import NamedTuple, Protocol

import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float


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

    def unweight(self, columns: Float[Array, "n r"]) -> Float[Array, "n r"]:
        """S⁻¹ times the columns."""
        return jsl.solve_triangular(self.root, columns)


def weigh(motion: Motion, offset: Float[Array, " n"] | None = None) -> Snapshots:
    """The weighted snapshots about `offset`, the first configuration unless given."""
    centre = motion.q[0] if offset is None else offset
    step = jnp.diff(motion.t)
    weights = 0.5 * (jnp.append(step, 0) + jnp.append(jnp.zeros(1, step.dtype), step))
    root = jnp.linalg.cholesky(motion.metric).T
    time = jnp.sqrt(weights)[None]
    return Snapshots(root @ (motion.q - centre).T * time, root @ motion.v.T * time, centre, root)
