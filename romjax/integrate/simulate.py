"""Simulation: the one way from a system to a trajectory."""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..common.arrays import Vector, as_number
from ..common.checks import check_finite
from ..common.compat import is_outermost, is_traced
from ..compiling.xla import tell_of_jit
from ..events.base import AbstractEvent
from ..events.check import check_events
from ..system.base import AbstractSystem
from ..system.consistent import check_start_shapes
from ..system.stabilization import Baumgarte, Projection, Stabilization
from ..system.start import Start
from ..system.structure import without_names
from .adjoint import has_root_finder, is_forward
from .default import at_start, default_method, warn_of_fast_stabilization
from .doubt import is_doubtful, is_unresolved, warn_of_doubt, without_failures
from .failures import raise_failure
from .follow.monitor import AbstractMonitor, check_monitors
from .left_out import flag_left_out
from .resolution import finer
from .run import run
from .settings import Settings, check_choices, check_numbers, check_times, progress_meter
from .ticks import ticks
from .trajectory import Trajectory

# Steps whose motion there is room for, unless told.
_DENSE_STEPS = 1024


def simulate(
    system: AbstractSystem,
    ts: Vector,
    *,
    q0: Vector | None = None,
    v0: Vector | None = None,
    solver: diffrax.AbstractSolver[Any] | None = None,
    rtol: ArrayLike = 1e-6,
    atol: ArrayLike | None = None,
    dt: ArrayLike | None = None,
    stabilization: Stabilization | Literal["default"] = "default",
    adjoint: diffrax.AbstractAdjoint | None = None,
    max_steps: int | None = 100_000,
    events: Sequence[AbstractEvent] = (),
    max_events: int = 256,
    dense: bool | int = False,
    follow: Sequence[AbstractMonitor] = (),
    progress: bool = False,
    throw: bool = True,
    audit: bool = True,
) -> Trajectory:
    """The motion of a system, full or reduced, at the times `ts`.

    Compiled once for each structure: other numbers, tolerances and names recompile nothing, nor do
    other numbers of steps and of outputs, but for more of these than the next power of two. Works
    under `jit`, `vmap`, `grad`, and `jacfwd` with `adjoint=diffrax.ForwardMode()`.

    **Arguments:**

    - `system`: from `assemble` or `reduce`, or a `CustomSystem`.
    - `ts` (k,): output times [s], increasing; the first is the start.

    **Keyword arguments:**

    - `q0`, `v0`: start in the system's coordinates; those of the system unless given.
    - `solver`: any diffrax solver; unless given, `Rodas5P()` where the fastest frequency of the
      system at its start is above what the outputs can show, and so far above that the steps
      that it saves pay for theirs, or where contacts with friction may begin; `diffrax.Dopri8()`
      elsewhere, at stops, ropes and contacts without friction too, and for rods that nothing damps
      (while JAX traces: Rodas5P for other flexible systems). `Trajectory.solver` is the one that
      was used.
    - `rtol`, `atol`: tolerances of the step size control. Unless `atol` is given, errors are
      relative to how far and how fast the motion has got, of whatever size it is; but where it
      has moved by more than a metre or a radian, or faster than one a second, they are `rtol` in
      these units and relative to each coordinate (`romjax/march/tolerances.py`). Where bodies
      turn, go round or swing N times by their velocities and accelerations at the start, and no
      joint prescribes a motion, steps take 9 / N² of that, from three turns to a hundred; those
      of explicit methods 9 / 25 at most (`romjax/integrate/turning.py`). The iterations of
      implicit methods of diffrax take `rtol` in metres for `atol`; with these, a motion of less
      than a centimetre is repeated with both as much smaller as it is (not while JAX traces, where
      `Trajectory.flags` says so).
    - `dt`: a fixed step [s] instead of step size control. With it, steps end where signals have
      corners, and see each cycle of those that vibrate (`AbstractSignal`); fixed steps do not.
    - `stabilization`: `Baumgarte(alpha, beta)`, `Projection()` or None; unless given, critical
      damping at a quarter of the mechanism's fastest rigid frequency, at all of it in fixed
      steps, and where energy does not balance with it, as it may at singular positions, the run
      is repeated with projection. While JAX traces, no run can be repeated, and mechanisms with
      closed loops are projected from the first.
    - `adjoint`: `diffrax.ForwardMode()` where derivatives are taken in forward mode, as inside
      `with romjax.forward_mode():`. Without it they are taken in reverse mode, with checkpoints,
      of any method; `diffrax.RecursiveCheckpointAdjoint()` stands for the same.
    - `max_steps`: most steps before giving up; None for no limit, but for 100 000 within
      transformations of JAX, unless derivatives are taken in forward mode.
    - `events`: moments to look for (`Crossing`, `Stop`, `Impact`): `Trajectory.events` says when
      they happened. Steps end at them, so that times and states there have the accuracy of the
      run, and derivatives. `max_events`: how many there is room for.
    - `dense`: keep the motion within each step, so that `Trajectory.at` gives it at any time; with
      room for 1024 steps, or for the number that is given.
    - `follow`: monitors of your own (`AbstractMonitor`), which see each accepted step;
      `Trajectory.followed` has what each has seen.
    - `progress`: show a progress bar.
    - `throw`: raise if the simulation fails; otherwise see `Trajectory.status`.
    - `audit`: draw up the balance of energy, `Trajectory.balance`. A run that gains or loses more
      than its tolerances explain is flagged (`Trajectory.is_valid`, `warnings()`), with a Python
      warning where JAX does not trace.

    Raises ValueError for a wrong argument or a start that violates the constraints (naming the
    joint and the amount); SimulationError if the integration does not reach its end, or not all
    joints hold on the way.
    """
    check_choices(system, solver, stabilization, adjoint, controlled=dt is None)
    check_numbers(max_steps, dense, rtol=rtol, atol=atol, dt=dt)
    tell_of_jit()
    q, v = _check_start(system, q0, v0)
    times = check_times("simulate", ts, q.dtype)
    # Events, monitors and controllers ask for bodies and coordinates by their names.
    watched = check_events(events, max_events, system, times, q, v)
    bare = system if watched or follow or ticks(system) else without_names(system)
    again = partial(_training, solver, stabilization, audit)
    step, known_start = None if dt is None else as_number(dt, q.dtype), None
    if solver is None or stabilization == "default":
        known_start = at_start(bare, times, q, v)
        solver = solver or default_method(system, times, step, known_start.frequencies).solver
    settings = Settings(
        solver=solver,
        rtol=as_number(rtol, q.dtype),
        atol=as_number(rtol if atol is None else atol, q.dtype),
        follow=np.asarray(atol is None),
        dt=step,
        stabilization=_stabilization(system, stabilization),
        projects_start=isinstance(stabilization, Projection),
        at_start=known_start,
        forward=is_forward(adjoint),
        max_steps=max_steps,
        meter=progress_meter(progress),
        audit=audit and system.n > 0,
        events=watched,
        max_events=max_events,
        dense=_DENSE_STEPS if dense is True else int(dense),
        monitors=check_monitors(follow),
    )
    trajectory, start = _run_well(system, partial(run, system, bare, times, q, v), settings)
    trajectory = flag_left_out(system, trajectory, settings.rtol, again, watched)
    if isinstance(stabilization, Baumgarte):
        warn_of_fast_stabilization(bare, trajectory, q, v)
    if throw:
        trajectory = raise_failure(system, trajectory, start)
    warn_of_doubt(system, trajectory)
    return without_failures(trajectory)


def _run_well(
    system: AbstractSystem,
    run_given: Callable[[Settings], tuple[Trajectory, Start]],
    settings: Settings,
) -> tuple[Trajectory, Start]:
    """A run, repeated with what suits its motion, unless JAX traces, and the constraints at its
    start.
    """
    # What was given stays.
    fits = bool(settings.follow) and has_root_finder(settings.solver)
    passes = settings.stabilization == "default"
    trajectory, constraints = run_given(settings)
    if fits and is_unresolved(trajectory):
        # A run whose tolerances exceed its motion tells the size of the motion badly, so that a
        # second run is asked for it.
        full = system.full.structure
        settings = finer(full, settings, trajectory)
        settings = finer(full, settings, run_given(settings)[0])
        trajectory, constraints = run_given(settings)
    if passes and system.m and is_doubtful(trajectory):
        # Baumgarte's terms may fail where the constraints lose rank, but projection gets past.
        projected = settings._replace(stabilization=Projection())
        other, other_constraints = run_given(projected)
        if not is_doubtful(other):
            trajectory, constraints = other, other_constraints
    return trajectory, constraints


def _training(
    solver: diffrax.AbstractSolver[Any] | None,
    stabilization: Stabilization | Literal["default"],
    audit: bool,
    rom: AbstractSystem,
    ts: Vector,
    rtol: float,
    q0: Vector | None = None,
    v0: Vector | None = None,
) -> Trajectory:
    """A motion that a reduced model was made of, repeated as the one that was asked for, but by
    default where JAX traces numbers of these choices, or a method needs fixed steps.
    """
    if any(is_traced(x) for x in jax.tree.leaves((solver, stabilization))):
        solver, stabilization = None, "default"
    solver = solver if isinstance(solver, diffrax.AbstractAdaptiveSolver) else None
    given: dict[str, Any] = {"solver": solver, "stabilization": stabilization, "audit": audit}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(rom, ts, q0=q0, v0=v0, rtol=rtol, throw=False, **given)


def _stabilization(
    system: AbstractSystem, given: Stabilization | Literal["default"]
) -> Stabilization | Literal["default"]:
    """Return the stabilization of a run.

    It is the given one, but for mechanisms with loops, while JAX traces, projection is the default:
    such a run cannot be repeated.
    """
    if given == "default" and system.structure.loops and not is_outermost():
        return Projection()
    return given


def _check_start(
    system: AbstractSystem, q0: Vector | None, v0: Vector | None
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The start; raise InputError for wrong shapes and numbers, warn of single precision."""
    q, v = check_start_shapes(system, q0, v0)
    check_finite("simulate", "q0", q)
    check_finite("simulate", "v0", v)
    if q.dtype == jnp.float32:
        warnings.warn(
            "Simulating in single precision: expect errors from 1e-5. For double precision, call "
            'jax.config.update("jax_enable_x64", True) before making any array.',
            stacklevel=3,
        )
    return q, v
