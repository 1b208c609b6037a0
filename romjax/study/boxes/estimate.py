"""The error of a reduced run, estimated by the model of the next rank."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from .reduced_box import reduced_as


def run_with_error_estimate(
    coarse: AbstractReducedSystem,
    fine: AbstractReducedSystem,
    system: AbstractSystem,
    times: Float[Array, " k"],
    rtol: Any,
) -> tuple[AbstractReducedSystem, Trajectory, Float[Array, ""]]:
    """Run the coarse model for a system with other numbers, and estimate the error of the run.

    Returns that model, its run from the start of the system, and ‖q̃_{r+1} − q̃_r‖ relative to the
    motion, which is infinite where one of the two runs failed.
    """
    rom, finer = reduced_as(coarse, system), reduced_as(fine, system)
    run, other = (simulate(x, times, rtol=rtol, throw=False) for x in (rom, finer))
    root = jnp.linalg.cholesky(system.mass(system.q0))
    change = jnp.linalg.norm((run.q - other.q) @ root)
    change /= jnp.linalg.norm((other.q - other.q[:1]) @ root)
    return rom, run, jnp.where(run.success & other.success, change, jnp.inf)
