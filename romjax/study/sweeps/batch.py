"""Runs of many systems of one structure, in one batch."""

import os
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_number, pick
from ...common.errors import InputError
from ...compiling.program import program
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from .sweep import sweep

# Runs of a chunk that processes share, of which there are some ten in all.
_SHARED = 4


class Sharing(NamedTuple):
    """A folder by which processes share runs, in chunks of so many, as of `sweep`."""

    path: str | os.PathLike[str] | None = None
    chunk: int | None = None


ALONE = Sharing()


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
    name: str, systems: list[AbstractSystem], training: Trajectory, sharing: Sharing = ALONE
) -> list[Trajectory]:
    """All systems in one batch, as accurately as the training, for the function `name`, or in
    chunks that processes share; without the audit of energy, which the training had, and which
    takes as long again to compile.

    Raises InputError if they differ in structure or one cannot be simulated.
    """
    rtol = as_number(1e-8 if training.stats.rtol is None else training.stats.rtol, training.q.dtype)
    numbers, structure = stacked(name, systems)
    one = _Lane(structure, training.t, rtol, training.solver)
    if sharing.path is None:
        batch = _simulate_batch(one, numbers)
    else:
        chunk = sharing.chunk or _SHARED
        batch = sweep(one, numbers, path=sharing.path, chunk=chunk).values
    runs = [jax.tree.map(lambda x, i=i: pick(x, i), batch) for i in range(len(systems))]
    for i, run in enumerate(runs):
        if not bool(run.success):
            raise InputError(f"{name}: system {i} cannot be simulated: {run.summary()}.")
    return runs


class _Lane(eqx.Module):
    """A function of the numbers of a system that returns its run."""

    structure: Any
    t: Float[Array, " k"]
    rtol: Any
    solver: Any

    def __call__(self, numbers: Any) -> Trajectory:
        system = eqx.combine(numbers, self.structure)
        settings = {"rtol": self.rtol, "solver": self.solver}
        return simulate(system, self.t, throw=False, audit=False, **settings)


@program
def _simulate_batch(one: _Lane, numbers: Any) -> Trajectory:
    runs: Trajectory = jax.vmap(one)(numbers)
    return runs
