"""Runs of many systems of one structure, in one batch."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_number, pick
from ..common.errors import InputError
from ..compiling.program import program
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..system.base import AbstractSystem


def stacked(name: str, systems: list[AbstractSystem]) -> tuple[Any, Any]:
    """The numbers of all systems, leading axis systems, and their structure.

    Raises InputError, as from the function `name`, if they differ in structure.
    """
    arrays = [eqx.partition(system, eqx.is_array) for system in systems]
    if len({jax.tree.structure(static) for _, static in arrays}) > 1:
        raise InputError(
            f"{name}: the systems differ in structure; give systems assembled from one scene with "
            "other numbers."
        )
    return jax.tree.map(lambda *x: np.stack(x), *(dynamic for dynamic, _ in arrays)), arrays[0][1]


def simulate_all(
    name: str, systems: list[AbstractSystem], training: Trajectory
) -> list[Trajectory]:
    """All systems in one batch, as accurately as the training, for the function `name`; without the
    audit of energy, which the training had, and which takes as long again to compile.

    Raises InputError if they differ in structure or one cannot be simulated.
    """
    rtol = as_number(1e-8 if training.stats.rtol is None else training.stats.rtol, training.q.dtype)
    batch = _simulate_batch(*stacked(name, systems), training.t, rtol, training.solver)
    runs = [jax.tree.map(lambda x, i=i: pick(x, i), batch) for i in range(len(systems))]
    for i, run in enumerate(runs):
        if not bool(run.success):
            raise InputError(f"{name}: system {i} cannot be simulated: {run.summary()}.")
    return runs


@program
def _simulate_batch(
    numbers: Any, structure: Any, t: Float[Array, " k"], rtol: Any, solver: Any
) -> Trajectory:
    def one(dynamic: Any) -> Trajectory:
        system = eqx.combine(dynamic, structure)
        return simulate(system, t, rtol=rtol, solver=solver, throw=False, audit=False)

    runs: Trajectory = jax.vmap(one)(numbers)
    return runs
