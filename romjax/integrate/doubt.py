"""Runs that end, and against which something speaks."""

import warnings

import numpy as np

from ..arrays import concrete
from ..system.base import AbstractSystem
from ..system.flags import Flag
from .singular import singular_position
from .status import Status
from .trajectory import Trajectory

# What a run is warned of, and what projection may mend.
_DOUBTS = Flag.ENERGY | Flag.DISSIPATION | Flag.BRANCH
_MENDED = Flag.ENERGY | Flag.BRANCH


def is_doubtful(run: Trajectory) -> bool:
    """Whether one run, not of those that JAX traces, may have lost joints, energy or branch."""
    status, flags = concrete(run.status), concrete(run.flags)
    if status is None or flags is None or np.ndim(status):
        return False
    lost = status == Status.SUCCESS and Flag(int(flags)) & _MENDED
    return bool(lost or status == Status.CONSTRAINTS_VIOLATED)


def warn_of_doubt(system: AbstractSystem, run: Trajectory) -> None:
    """Warn of one run, not of those that JAX traces, that ended, of what speaks against it."""
    status, flags = concrete(run.status), concrete(run.flags)
    if status is None or flags is None or np.ndim(status) or status != Status.SUCCESS:
        return
    if not Flag(int(flags)) & _DOUBTS:
        return
    words = [f"simulate: the motion is doubtful: {run.warnings()}"]
    singular = singular_position(system, run)
    if singular is not None and singular.is_passed:
        words.append(singular.describe())
    warnings.warn(
        f"{'; '.join(words)}. Tighten rtol, or use stabilization=romjax.Projection().",
        stacklevel=3,
    )
