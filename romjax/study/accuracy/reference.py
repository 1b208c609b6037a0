"""The motion that errors are measured against."""

import dataclasses
import functools
from typing import NamedTuple

import diffrax
import numpy as np

from ...basis.decomposition.pod import POD
from ...common.arrays import as_jax
from ...common.errors import ReductionError, SimulationError
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.parse import as_formulation
from ...reduction.reduce import reduce
from ...system.base import AbstractSystem
from ...system.stabilization import Projection
from ..compare import compare
from .configuration import Configuration

# So many times tighter than the tightest run, or as tight as rounding allows.
_TIGHTER, _TIGHTEST = 1e-4, 1e-13


class Reference(NamedTuple):
    """A motion to measure errors against."""

    motion: Trajectory
    words: str  # what it is
    floor: float  # its own error; NaN where it could not be checked


def make_reference(full: Configuration, training: Trajectory, tightest: float) -> Reference:
    """The reference for runs at tolerances down to `tightest`, at the times of the `training`.

    In minimal coordinates, all of them: the same motion by other equations than those of the `full`
    model, whose own run at the same tolerance says how far the two are apart.
    """
    rtol = max(_TIGHTER * tightest, _TIGHTEST)
    second = full.run(rtol)
    words = f"at rtol={rtol:.0e}, checked by redundant ones with {full.method}"
    if not bool(second.success):
        words = f"at rtol={rtol:.0e}, unchecked, as {full.method} failed there ({second.summary()})"
    run = functools.partial(simulate, rtol=rtol, max_steps=1_000_000)
    system = full.model.system
    try:
        complete = _all_minimal_coordinates(training, system)
        first = run(complete, training.t, solver=diffrax.Dopri8())
        words = f"minimal coordinates by Dopri8 {words}"
    except (ReductionError, SimulationError):
        # The same equations, so at least another method and another stabilisation.
        explicit = isinstance(full.solver, diffrax.Dopri8)
        solver = diffrax.Tsit5() if explicit else diffrax.Dopri8()
        first = run(system, training.t, solver=solver, stabilization=Projection())
        words = f"redundant coordinates with projection by {type(solver).__name__} {words}"
    floor = float(compare(first, second).error) if bool(second.success) else np.nan
    return Reference(first, words, floor)


def _all_minimal_coordinates(training: Trajectory, system: AbstractSystem) -> AbstractSystem:
    """The system in minimal coordinates, with as many modes as there are coordinates."""
    basis = POD(rank=1)(training)  # for its snapshots, which choose the independent coordinates
    given = dataclasses.replace(basis, modes=as_jax(np.eye(system.n)), decomposition=None)
    complete = given.orthonormalised(training.metric)
    return reduce(system, complete, as_formulation("minimal"))
