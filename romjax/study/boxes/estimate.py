"""The error of a reduced run, estimated by models that know more."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ..compare import compare
from ..errors.flow import Flows
from .reduced_box import reduced_as


def run_with_error_estimate(
    coarse: AbstractReducedSystem,
    finer: Sequence[AbstractReducedSystem],
    system: AbstractSystem,
    times: Float[Array, " k"],
    rtol: Any,
) -> tuple[AbstractReducedSystem, Trajectory, Float[Array, ""]]:
    """Run the coarse model for a system with other numbers, and estimate the error of the run.

    Returns that model, its run from the start of the system, and the largest error against runs of
    the `finer` models (`romjax.study.errors.richer`) from that start, which is infinite where one
    of the runs failed, and zero without such models.
    """
    rom = reduced_as(coarse, system)
    run = simulate(rom, times, rtol=rtol, throw=False)
    # The largest distance to any finer model: two of them rarely miss the same.
    errors = [jnp.zeros((), run.q.dtype)]
    for one in finer:
        other = simulate(reduced_as(one, system), times, rtol=rtol, throw=False)
        error = compare(other, run).error
        errors.append(jnp.where(run.success & other.success, error, jnp.inf))
    return rom, run, jnp.max(jnp.stack(errors))


def run_with_error_by_flow(
    coarse: AbstractReducedSystem,
    flows: Flows,
    system: AbstractSystem,
    times: Float[Array, " k"],
    rtol: Any,
) -> tuple[Trajectory, Float[Array, ""]]:
    """Run the coarse model for a system with other numbers, and estimate the error of the run by
    the flow along known motions; infinite where the run failed.
    """
    rom = reduced_as(coarse, system)
    run = simulate(rom, times, rtol=rtol, throw=False)
    change, _ = flows.error(rom, run, system.q0, system.v0)
    error = compare(dataclasses.replace(run, q=run.q + change), run).error
    return run, jnp.where(run.success, error, jnp.inf)
