"""The inertia of a rod, by its Gauss points."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .rod_kinematics import Line, acceleration, jacobian, slopes


def mass_matrix(line: Line, mass: Any, rotary: Any, q: Float[Array, " size"]) -> Array:
    """∫ρ JᵀJ of the points, and of the turning of the sections with the rotary inertia [kg m]."""
    own, (_, columns) = line.strains, jacobian(line, q)
    flat, weights = columns.reshape(-1, columns.shape[2]), own.weights()
    # A section turns with the frame and by the sum of the curvatures before it.
    section = np.array([[0.0, 0.0, 1.0]]).repeat(own.points, axis=0)
    turned = jnp.concatenate([section, own.turn], axis=1)
    # One product over both components and all points, in place of a loop over points.
    moved = (flat.T * np.tile(weights, 2)[None]) @ flat
    total: Array = mass * moved + rotary * line.length * ((turned.T * weights[None]) @ turned)
    return total


def velocity_force(
    line: Line, mass: Any, q: Float[Array, " size"], v: Float[Array, " size"]
) -> Float[Array, " size"]:
    """−∫ρ Jᵀ r̈ at q̈ = 0; sections turn linearly in q, and add nothing."""
    position, columns = jacobian(line, q)
    force = acceleration(line, q, v, position) * line.strains.weights()[None]
    total: Array = -mass * (force.reshape(-1) @ columns.reshape(-1, columns.shape[2]))
    return total


def first_moment(line: Line, mass: Any, q: Float[Array, " size"]) -> Float[Array, "2"]:
    """∫ρ r [kg m]."""
    own = line.strains
    mean = slopes(line, q[3:]).slope @ (own.positions().T @ own.weights())
    x, y = line.origin() + line.length * mean
    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    moment: Array = mass * (q[:2] + jnp.stack([c * x - s * y, s * x + c * y]))
    return moment


def first_moment_slope(line: Line, mass: Any, q: Float[Array, " size"]) -> Float[Array, "2 size"]:
    """Its derivative: the mean of those of the Gauss points, which the mass matrix is made of."""
    _, columns = jacobian(line, q)
    mean = jnp.sum(columns * line.strains.weights()[None, :, None], axis=1)
    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    slope: Array = mass * (jnp.stack([c, -s, s, c]).reshape(2, 2) @ mean)
    return slope
