"""The motion that errors are measured against."""

import dataclasses

import diffrax
import jax.numpy as jnp
import numpy as np

from ...basis.decomposition.pod import pod
from ...errors import ReductionError, SimulationError
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.reduce import reduce
from ...system.base import AbstractSystem
from ...system.stabilization import Projection
from ..compare import compare
from .measure import Way

# So many times tighter than the tightest run, or as tight as rounding allows.
_TIGHTER, _TIGHTEST = 1e-4, 1e-13


def make_reference(
    way: Way, training: Trajectory, tightest: float
) -> tuple[Trajectory, str, float]:
    """A motion to measure errors of runs down to a tolerance against, what it is in words, and its
    own error, by the full model's `way`.
    """
    rtol = max(_TIGHTER * tightest, _TIGHTEST)
    second = way.run(rtol)
    words = f"at rtol={rtol:.0e}, checked by redundant ones with {way.method}"
    if not bool(second.success):
        words = f"at rtol={rtol:.0e}, unchecked, as {way.method} failed there ({second.reason()})"
    settings = {"rtol": rtol, "adjoint": diffrax.ForwardMode(), "max_steps": 1_000_000}
    system = way.model.system
    try:
        first = simulate(
            _complete(training, system), training.t, solver=diffrax.Dopri8(), **settings
        )
        words = f"minimal coordinates by Dopri8 {words}"
    except (ReductionError, SimulationError):
        # The same equations, so at least another method and another stabilisation.
        solver = diffrax.Tsit5() if way.method == "Dopri8" else diffrax.Dopri8()
        keep = Projection()
        first = simulate(system, training.t, solver=solver, stabilization=keep, **settings)
        words = f"redundant coordinates with projection by {type(solver).__name__} {words}"
    floor = float(compare(first, second).error) if bool(second.success) else np.nan
    return first, words, floor


def _complete(training: Trajectory, system: AbstractSystem) -> AbstractSystem:
    """The system in minimal coordinates, all of them: the same motion by other equations."""
    basis = pod(training, rank=1)
    given = dataclasses.replace(basis, modes=jnp.eye(system.n), decomposition=None)
    return reduce(system, given.orthonormalised(training.metric), "minimal")
