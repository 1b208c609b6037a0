"""Accelerations and joint forces of a mechanism from the motion of its reduced model."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.errors import InputError
from ..system.dynamics import solve
from ..system.reduced import AbstractReducedSystem, reduced_of
from .origin import check_origin
from .trajectory import Trajectory


def lifted_acceleration(
    rom: AbstractReducedSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> Float[Array, " n"]:
    """The acceleration of the physical coordinates at a physical state (`t`, `q`, `v`) of the
    reduced system `rom`, without stabilisation.
    """
    own = rom.in_chart_of(q)
    z, w = own.restrict(q, v)
    return own.state(t, z, w).physical_acceleration(own.acceleration(t, z, w)[0])


def reactions(rom: AbstractReducedSystem, trajectory: Trajectory) -> Float[Array, "k m"]:
    """Lagrange multipliers of all constraints of the full system, (k, m), along a reduced run.

    A reduced model has few multipliers or none. Those of the mechanism follow from the balance
    M q̈ + C_qᵀ λ = Q of the rigid-body coordinates, with the acceleration of the reduced model: one
    small least-squares problem for each output. Modal coordinates are left out: a dropped mode
    balances the joint forces by its elastic force, of which the reduced model knows nothing. Of
    joint coordinates, which drop nothing, they are those of the full system.

    **Arguments:** the reduced system `rom`; a `trajectory` that was simulated with it. Raises
    InputError for a full system, and for a run of another one.
    """
    check_origin("reactions", rom, trajectory)
    if reduced_of(rom) is None:
        raise InputError(
            "reactions: the system is no reduced model; of a full system, "
            "romjax.joint_forces(system, run) has the forces of the joints."
        )
    return _reactions(rom, trajectory.t, trajectory.q, trajectory.v)


# The run is judged before, where its numbers are known and not traced.
@eqx.filter_jit
def _reactions(
    rom: AbstractReducedSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> Float[Array, "k m"]:
    def forces(t: Array, q: Array, v: Array) -> Array:
        if rom.is_exact:
            return solve(rom.full, t, q, v, None).multipliers
        return balancing_multipliers(rom, t, q, v, lifted_acceleration(rom, t, q, v))

    return jax.vmap(forces)(t, q, v)


def balancing_multipliers(
    rom: AbstractReducedSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    a: Float[Array, " n"],
) -> Float[Array, " m"]:
    """The multipliers with which the rigid-body coordinates of the full system are in balance at
    the physical state (`t`, `q`, `v`) of `rom` and the acceleration `a`.
    """
    full = rom.full
    rigid = jnp.array(full.structure.rigid)
    state = full.state(t, q, v)
    # Rows of a rigid coordinate by the root of its mass: forces of heavy and of light bodies, and
    # torques, then count by the accelerations that they would make.
    weight = jnp.where(rigid, 1 / jnp.sqrt(jnp.diagonal(full.mass(q))), 0)
    # Least squares gives the shares of least norm to constraints that repeat each other.
    rows = state.jacobian().T * weight[:, None]
    return jnp.linalg.lstsq(rows, -weight * state.residual(a))[0]
