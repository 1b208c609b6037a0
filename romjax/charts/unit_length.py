"""The constraints of a mechanism whose quaternions are of unit length.

A mechanism in space moves alike for any length, which its equations of motion leave as it is. As a
coordinate it would count as a freedom of each body, so the rows |p|² = 1 take it out.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg import quaternions
from ..system import dynamics
from ..system.base import AbstractSystem


def count(system: AbstractSystem) -> int:
    """How many constraints there are."""
    return system.m + len(system.structure.quaternions)


def extended(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, " M"]:
    """C(t, q), then ½ (|p|² − 1) of each body in space."""
    own = system.constraint(t, q)
    if not system.structure.quaternions:
        return own
    lengths = 0.5 * (jnp.sum(q[quaternions.columns(system.structure.quaternions)] ** 2, axis=1) - 1)
    return jnp.concatenate([own, lengths])


def jacobian(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, "M n"]:
    """Their derivatives by q."""
    own = dynamics.jacobian(system, t, q)
    if not system.structure.quaternions:
        return own
    table = quaternions.columns(system.structure.quaternions)
    rows = jnp.zeros((len(table), system.n), q.dtype)
    rows = rows.at[np.arange(len(table))[:, None], table].set(q[table])
    return jnp.concatenate([own, rows])
