"""The settings of a simulation, and checks of what users pass for them."""

import functools
import math
from typing import Any, Literal, NamedTuple

import diffrax
import jax
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..common.arrays import Vector, as_array, concrete
from ..common.checks import check_finite, check_kind, check_positive, check_shape
from ..common.errors import InputError
from ..common.identity_cache import IdentityCache
from ..events.base import AbstractEvent
from ..system.base import AbstractSystem, check_system
from ..system.frequencies import Frequencies
from ..system.stabilization import Baumgarte, Projection, Stabilization
from ..system.start import Start
from .follow.monitor import AbstractMonitor
from .ticks import ticks

# Where derivatives in reverse mode must know how many steps there may be, and none is given.
_MOST_STEPS = 100_000
# What holds a single number.
_NUMBERS = int, float, jax.Array, np.ndarray, np.number


class AtStart(NamedTuple):
    """Facts about the state that a run starts from, which choices and its judgement need.

    `energy`: of all [J]; zero without coordinates.
    """

    frequencies: Frequencies
    constraints: Start
    energy: Float[Array, ""]


class Settings(NamedTuple):
    """Everything about a simulation but the system, the output times and the start.

    A tuple, since every call of `simulate` takes it apart: a module costs 0.03 ms more.

    - `rtol`, `atol`: tolerances of the step size control, or `dt` [s], a fixed step. `follow`:
      whether the tolerances are those of the motion, and not `atol`, as `Tolerances` has it.
    - `stabilization`: "default" until the run replaces it. `projects_start`: whether a start that
      violates the constraints is projected too, or refused.
    - `at_start`: where a choice needs it; the run finds constraints by itself otherwise.
    - `forward`: whether derivatives are taken in forward mode. `max_steps` may be an array where
      nobody differentiates.
    - `meter`: what shows the progress. `audit`: whether the balance of energy is drawn up; not
      without coordinates, where no equation of motion is integrated that could gain energy.
    - `events`: that are watched; `max_events`: how many of them there is room for.
    - `dense`: for how many steps dense output has room; 0 without it.
    - `monitors`: of users, that follow the run.
    - `states`: how many states at the ends of steps are saved of a mechanism with contacts.
    """

    solver: diffrax.AbstractSolver[Any]
    rtol: Float[Array | np.ndarray, ""]
    atol: Float[Array | np.ndarray, ""]
    follow: bool | Bool[np.ndarray, ""]
    dt: Float[Array | np.ndarray, ""] | None
    stabilization: Stabilization | Literal["default"]
    projects_start: bool
    at_start: AtStart | None
    forward: bool
    max_steps: int | Int[Array | np.ndarray, ""] | None
    meter: diffrax.AbstractProgressMeter[Any]
    audit: bool
    events: tuple[AbstractEvent, ...]
    max_events: int
    dense: int
    monitors: tuple[AbstractMonitor, ...]
    states: int = 0

    def known_start(self, system: AbstractSystem) -> AtStart | None:
        """Return what is known of the state in which the run begins: nothing if it is projected
        first, or if controllers have set something in it.
        """
        projects = self.projection is not None and self.projects_start
        return None if projects or ticks(system) else self.at_start

    @property
    def frequencies(self) -> Frequencies | None:
        """The frequencies of the system at its start, if they are known."""
        return None if self.at_start is None else self.at_start.frequencies

    def limited(self, traced: bool) -> "Settings":
        """The same with a number of steps where there is no limit: the largest number, or the usual
        one where the run is `traced` as a part of a transformation, which may be reverse mode.
        """
        if self.max_steps is not None:
            return self
        largest = int(np.iinfo(jax.dtypes.canonicalize_dtype(int)).max)
        return self._replace(max_steps=_MOST_STEPS if traced and not self.forward else largest)

    @property
    def baumgarte(self) -> Baumgarte | None:
        """The terms that the equations of motion contain."""
        return self.stabilization if isinstance(self.stabilization, Baumgarte) else None

    @property
    def projection(self) -> Projection | None:
        """The projection that follows each step."""
        return self.stabilization if isinstance(self.stabilization, Projection) else None

    @property
    def holds_constraints(self) -> bool:
        """Whether a run promises that the constraints hold; in fixed steps, only by projection."""
        controlled = self.baumgarte is not None and self.dt is None
        return self.projection is not None or controlled


@functools.cache
def progress_meter(shown: bool) -> diffrax.AbstractProgressMeter[Any]:
    """Return the progress meter of a run; made once, since making it takes 7 µs."""
    return diffrax.TqdmProgressMeter() if shown else diffrax.NoProgressMeter()


def check_choices(
    system: AbstractSystem,
    solver: diffrax.AbstractSolver[Any] | None,
    stabilization: Stabilization | Literal["default"],
    adjoint: diffrax.AbstractAdjoint | None,
    controlled: bool,
) -> None:
    """Raise InputError for what is no system, no method, or no way to hold constraints or to
    differentiate, and for a method that cannot choose its steps where these are `controlled`.
    """
    check_system("simulate", system)
    if adjoint is not None:
        remedy = "an object such as diffrax.ForwardMode()"
        check_kind("simulate", "adjoint", adjoint, diffrax.AbstractAdjoint, remedy)
    if not isinstance(adjoint, diffrax.ForwardMode | diffrax.RecursiveCheckpointAdjoint | None):
        raise InputError(
            f"simulate: adjoint={type(adjoint).__name__}(), but derivatives are taken in forward "
            "mode by diffrax.ForwardMode(), and in reverse mode, by checkpoints of romjax's own, "
            "without an adjoint. (Backwards in time, dampers and the stabilisation of the "
            "constraints make a motion grow.)"
        )
    if solver is not None:
        remedy = "an object such as romjax.Rodas5P() or diffrax.Tsit5()"
        check_kind("simulate", "solver", solver, diffrax.AbstractSolver, remedy)
        if controlled and not isinstance(solver, diffrax.AbstractAdaptiveSolver):
            raise InputError(
                f"simulate: {type(solver).__name__} does not estimate the errors of its steps, "
                "which the step size control needs; give dt, a fixed step [s], or another method."
            )
    if isinstance(stabilization, Baumgarte) or stabilization in ("default", None):
        return
    remedy = 'romjax.Baumgarte(alpha, beta), romjax.Projection(), None or "default"'
    check_kind("simulate", "stabilization", stabilization, Projection, remedy)


def check_numbers(max_steps: int | None, dense: int, **steps: ArrayLike | None) -> None:
    """Raise InputError for counts below their least, and for `steps` that must be positive."""
    for name, value in steps.items():
        # Numbers of Python, which most are, at a tenth of the price.
        if value is not None and not (type(value) is float and 0 < value < math.inf):
            check_kind("simulate", name, value, _NUMBERS, "a positive number")
            check_shape("simulate", name, value, ())
            check_positive("simulate", name, value)
    if (max_steps is not None and max_steps < 1) or dense < 0:
        raise InputError(
            f"simulate: max_steps={max_steps}, dense={dense}; a run takes at least one step, None "
            "stands for any number, and dense output has room for a number of steps, or is False."
        )


_increasing = IdentityCache()  # of arrays of JAX, which never change


def check_times(owner: str, ts: Vector, dtype: Any) -> Float[Array, " k"]:
    """The output times as an array; raise ValueError, beginning with `owner`, unless they are
    finite and increase.
    """
    try:
        times = as_array(ts)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{owner}: ts is of type {type(ts).__name__} and no array of times; give the times of "
            "the outputs, such as jax.numpy.linspace(0.0, 1.0, 101)."
        ) from error
    times = times if times.dtype == dtype else times.astype(dtype)
    if _increasing.get(times):
        return times
    check_shape(owner, "ts", times, (None,))
    check_finite(owner, "ts", times)
    if times.shape[0] < 2:
        raise ValueError(f"{owner}: ts has {times.shape[0]} entries; give the start and the end.")
    numbers = concrete(times)
    if numbers is not None and not np.all(np.diff(numbers) > 0):
        index = int(np.argmin(np.diff(numbers)))
        raise ValueError(
            f"{owner}: ts must increase, but ts[{index}] = {numbers[index]:g} is followed by "
            f"{numbers[index + 1]:g}."
        )
    if numbers is not None:
        _increasing.put(times, True)
    return times
