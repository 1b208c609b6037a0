"""Joint forces of a mechanism from the motion of its reduced model."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..reduction.base import AbstractReducedSystem
from .trajectory import Trajectory


@eqx.filter_jit
def reactions(rom: AbstractReducedSystem, trajectory: Trajectory) -> Float[Array, "k m"]:
    """Lagrange multipliers of all constraints of the full system, (k, m), along a reduced run.

    A reduced model has few multipliers or none. Those of the mechanism follow from the balance
    M q̈ + C_qᵀ λ = Q of the rigid-body coordinates, with the acceleration of the reduced model: one
    small least-squares problem for each output. Modal coordinates are left out: a dropped mode
    balances the joint forces by its elastic force, of which the reduced model knows nothing.

    **Arguments:** the reduced system `rom`; a `trajectory` that was simulated with it.
    """
    full = rom.full
    rigid = full.rigid()

    def forces(t, q, v):  # type: ignore[no-untyped-def]
        state = rom.reduced(q, v)
        a = rom.physical_acceleration(t, *state, rom.acceleration(t, *state)[0])
        weight = jnp.where(rigid, 1 / jnp.sqrt(jnp.diagonal(full.mass(q))), 0)
        rest = full.force(t, q, v) - full.momentum(q, a)
        rows = full.jacobian(t, q).T * weight[:, None]
        return jnp.linalg.lstsq(rows, weight * rest)[0]

    return jax.vmap(forces)(trajectory.t, trajectory.q, trajectory.v)
