"""Runs in which a mechanism moves out of its reduced model."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import concrete
from ..common.compat import is_traced
from ..common.outside import outside_of_traces
from ..compiling.program import program_once
from ..events.base import AbstractEvent
from ..system.base import AbstractSystem
from ..system.dynamics import jacobian
from ..system.flags import Flag
from ..system.reduced import AbstractReducedSystem
from ..system.structure import without_names
from ..system.training import Training
from .departure import departure
from .trajectory import Trajectory

# A row of constraints that leaves less than this of its length to those before it repeats them.
_REPEATED = 1e-9


def has_fewer_freedoms(training: Training) -> bool:
    """Whether the mechanism has freedoms that its model has not, counted once at the start."""
    if training.has_fewer_freedoms is None:
        rom = without_names(training.rom)

        def count() -> None:
            training.has_fewer_freedoms = _freedoms(rom, rom.time) < _freedoms(
                rom.full, rom.time, rom
            )

        outside_of_traces(count)
    return bool(training.has_fewer_freedoms)


def _freedoms(system: AbstractSystem, t: Array, rom: AbstractReducedSystem | None = None) -> int:
    """The freedoms that constraints of a system leave at its start, or at that of its model."""
    structure = system.structure
    # The length of a quaternion is no freedom, and neither is a state of an effect.
    count = system.n - len(structure.quaternions) - len(structure.states)
    if not system.m:
        return count
    rows = np.asarray(_rows(system, t, rom))
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = rows / np.where(lengths > 0, lengths, 1)
    return count - int(np.linalg.matrix_rank(rows, tol=_REPEATED))


@program_once
def _rows(
    system: AbstractSystem, t: Array, rom: AbstractReducedSystem | None
) -> Float[Array, "m n"]:
    q = system.q0 if rom is None else rom.reconstruct(t, rom.q0, rom.v0)[0]
    return jacobian(system, t, q)


def flag_departure(
    system: AbstractReducedSystem,
    run: Trajectory,
    limit: Any,
    tried: Any,
    events: tuple[AbstractEvent, ...],
) -> Any:
    """`Flag.UNMODELLED` where the mechanism departs from a run by more than a `limit`; zero of runs
    that somebody has `tried`.
    """
    if concrete(tried) is None:
        far = jax.lax.cond(
            tried, lambda: jnp.zeros((), run.q.dtype), lambda: departure(system, run, events)
        )
    else:
        far = 0.0 if tried else departure(system, run, events)
    if is_traced(far) or is_traced(limit):
        return jnp.where(far > limit, int(Flag.UNMODELLED), 0)
    return int(Flag.UNMODELLED) if far > limit else 0
