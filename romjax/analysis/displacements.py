"""The size of a large displacement of each coordinate: the metric of statics."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..system import dynamics
from ..system.base import AbstractSystem
from ..system.structure import Structure


def displacements(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, " n"]:
    """Displacements (n,) of the coordinates that are as large as the mechanism.

    Of positions its length ℓ, that of the largest lever in C_q or between bodies, or 1 m where
    there is none; of turns 1 rad, which is |p|/2 of a quaternion p; of modes what moves points by
    about ℓ, ℓ √(mass of the body / modal mass), a number of its shapes alone. No moment of inertia
    counts, as none does in statics. Where no bodies are known, as in reduced systems, 1/√M.
    """
    weights = jnp.diagonal(system.mass(q))
    if not system.structure.frames:
        return 1 / jnp.sqrt(weights)
    positions, turns = system.structure.positions, system.structure.turns
    modes, owners = _modes(system.structure)
    places = q[positions]
    length = jnp.max(jnp.abs(places - jnp.mean(places, axis=0, keepdims=True)))
    sizes = jnp.ones_like(q)
    if system.structure.quaternions:
        sizes = sizes.at[turns].set(0.5 * jnp.linalg.norm(q[turns], axis=1, keepdims=True))
    if system.m:
        rows = jnp.abs(dynamics.jacobian(system, t, q) * sizes[None])
        far, near = (jnp.max(rows[:, x.ravel()], axis=1) for x in (turns, positions))
        length = jnp.maximum(length, jnp.max(far / jnp.where(near > 0, near, jnp.inf)))
    length = jnp.where(length > 0, length, 1.0)
    sizes = sizes.at[positions].set(length)
    return sizes.at[modes].set(length * jnp.sqrt(weights[owners] / weights[modes]))


def _modes(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of modes, and where the frames of their bodies begin."""
    frames = np.concatenate([structure.positions, structure.turns], axis=1)
    others = {*frames.ravel().tolist(), *structure.counters, *structure.states}
    modes = np.array([i for i in range(len(structure.coordinates)) if i not in others], int)
    owners = np.array([max(s for s in structure.frames if s < i) for i in modes], int)
    return modes, owners
