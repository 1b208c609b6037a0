"""The constraints of a mechanism whose quaternions are of unit length.

A mechanism in space moves alike for any length, which its equations of motion leave as it is. As a
coordinate it would count as a freedom of each body, so the rows |p|² = 1 take it out.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..linalg import quaternions
from . import dynamics
from .base import AbstractSystem


def count(system: AbstractSystem) -> int:
    """Return the number of constraints, lengths of quaternions included."""
    return system.m + len(system.structure.quaternions)


def freedoms(system: AbstractSystem) -> int:
    """Return the number of freedoms that the constraints leave, where none repeats others."""
    return system.n - count(system)


def extended(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, " M"]:
    """C(t, q), then ½ (|p|² − 1) of each body in space."""
    own = system.constraint(t, q)
    if not system.structure.quaternions:
        return own
    # Half of it, so that the Jacobian has the quaternion itself as its row.
    lengths = 0.5 * (jnp.sum(q[quaternions.columns(system.structure.quaternions)] ** 2, axis=1) - 1)
    return jnp.concatenate([own, lengths])


def jacobian(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, "M n"]:
    """Return the Jacobian of all constraints, lengths of quaternions included."""
    own = dynamics.jacobian(system, t, q)
    if not system.structure.quaternions:
        return own
    table = quaternions.columns(system.structure.quaternions)
    rows = jnp.zeros((len(table), system.n), q.dtype)
    rows = rows.at[np.arange(len(table))[:, None], table].set(q[table])
    return jnp.concatenate([own, rows])


def with_lengths(
    system: AbstractSystem,
    q: Float[Array, " n"],
    x: Float[Array, "n k"],
    given: Float[Array, "bodies k"] | None = None,
) -> Float[Array, "n k"]:
    """Changes of the coordinates whose p·x, by which lengths change, are the `given` ones, or zero.

    A change along p moves nothing, keeps all joints, and is orthogonal to all other changes in the
    mass metric.
    """
    if not system.structure.quaternions:
        return x
    table = quaternions.columns(system.structure.quaternions)
    p, own = q[table][:, :, None], x[table]
    # Along p alone: the turn, which is across p, stays as it is.
    missing = -jnp.sum(p * own, axis=1, keepdims=True)
    if given is not None:
        missing += given[:, None]
    return x.at[table].add(missing / jnp.sum(p * p, axis=1, keepdims=True) * p)
