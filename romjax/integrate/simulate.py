"""Simulation: the one way from a system to a trajectory."""

import warnings
from typing import Any, Literal, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from .. import compat
from ..arrays import Vector, as_number
from ..checks import check_finite
from ..compat import is_traced
from ..errors import InputError
from ..program import program
from ..system.base import AbstractSystem, Run
from ..system.consistent import check_start_shapes
from ..system.constraints import ConstraintState, differentiate
from ..system.stabilization import Baumgarte, Stabilization
from ..system.structure import without_names
from .adjoint import default_adjoint
from .default import default_solver, start_frequencies, warn_of_fast_stabilization
from .derived import Derived, OnDemand, metric_of, multipliers_at
from .failures import raise_failure
from .integration import integrate
from .judge import judge_run
from .outputs import Output, capacity, cut, padded
from .parts import Parts
from .rodas5p import Rodas5P
from .settings import Settings, check_times
from .statistics import Statistics
from .trajectory import Trajectory


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
    max_steps: int = 100_000,
    progress: bool = False,
    throw: bool = True,
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
      system at its start is above what the outputs can show, `diffrax.Dopri8()` elsewhere (while
      JAX traces: Rodas5P for flexible systems). `Trajectory.solver` is the one that was used.
    - `rtol`, `atol`: tolerances of the step size control; `atol` equals `rtol` unless given.
    - `dt`: a fixed step [s] instead of step size control.
    - `stabilization`: `Baumgarte(alpha, beta)`, `Projection()` or None; unless given, critical
      damping at the mechanism's fastest rigid frequency.
    - `adjoint`: how derivatives are taken, where the run is part of a transformation; reverse mode
      with checkpoints unless given, or inside `with romjax.forward_mode():`.
    - `max_steps`: most steps before giving up.
    - `progress`: show a progress bar.
    - `throw`: raise if the simulation fails; otherwise see `Trajectory.status`.

    Raises ValueError for a wrong argument or a start that violates the constraints (naming the
    joint and the amount); SimulationError if the integration does not reach its end, or not all
    joints hold on the way.
    """
    times = check_times(ts)
    q, v = check_start_shapes(system, q0, v0)
    check_finite("simulate", "q0", q)
    check_finite("simulate", "v0", v)
    times = times if times.dtype == q.dtype else times.astype(q.dtype)
    _check_for_doubts(q, adjoint)
    bare, frequencies = without_names(system), None
    step = None if dt is None else as_number(dt, q.dtype)
    if solver is None or stabilization == "default":
        first = times[0] if is_traced(times) else as_number(np.asarray(times)[0], q.dtype)
        frequencies = start_frequencies(bare, first, q, v)
        if solver is None:
            solver = default_solver(system, times, step, frequencies)
    settings = Settings(
        solver=solver,
        rtol=as_number(rtol, q.dtype),
        atol=as_number(rtol if atol is None else atol, q.dtype),
        dt=step,
        stabilization=stabilization,
        frequencies=frequencies,
        adjoint=default_adjoint(solver) if adjoint is None else adjoint,
        max_steps=max_steps,
        meter=diffrax.TqdmProgressMeter() if progress else diffrax.NoProgressMeter(),
    )
    run, derived = _run(bare, times, q, v, settings)
    trajectory = _trajectory(system, times, run, derived, settings)
    chosen = isinstance(stabilization, Baumgarte)
    if chosen and not isinstance(solver, Rodas5P | diffrax.AbstractImplicitSolver):
        warn_of_fast_stabilization(bare, trajectory, q, v)
    return raise_failure(system, trajectory, run.start) if throw else trajectory


def _check_for_doubts(q0: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None) -> None:
    """Warn of single precision; raise InputError for an adjoint that grows without bounds."""
    if q0.dtype == jnp.float32:
        warnings.warn(
            "Simulating in single precision: expect errors from 1e-5. For double precision, call "
            'jax.config.update("jax_enable_x64", True) before making any array.',
            stacklevel=3,
        )
    if isinstance(adjoint, diffrax.BacksolveAdjoint):
        raise InputError(
            "simulate: adjoint=BacksolveAdjoint() integrates the motion backwards in time, where "
            "dampers and the stabilisation of the constraints make it grow; use "
            "diffrax.RecursiveCheckpointAdjoint() or diffrax.ForwardMode()."
        )


class _Result(NamedTuple):
    """What a run gives but for names."""

    outputs: Output
    start: ConstraintState
    status: Int[Array, ""]
    flags: Int[Array, ""]
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    rejected: Int[Array, ""]
    stabilization: Stabilization


def _run(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[_Result, Derived | OnDemand]:
    """The run, by a program of its own that others share, or as a part of the user's."""
    if not compat.is_outermost() or isinstance(settings.solver, diffrax.AbstractImplicitSolver):
        return _differentiable(system, ts, q0, v0, settings)
    count = len(ts)
    size = capacity(count, 2 * system.full.n, q0.dtype)
    settings = settings._replace(max_steps=np.asarray(settings.max_steps), adjoint=None)
    times = ts if size == count else padded(ts, size)
    result: _Result = _plain(system, times, np.asarray(count), q0, v0, settings)
    outputs = cut(result.outputs, count)
    own = outputs.in_system()
    demand = OnDemand(
        Parts.of(system), ts, own.q, own.v, own.chart, _baumgarte(result.stabilization)
    )
    return result._replace(outputs=outputs), demand


@eqx.filter_jit
def _differentiable(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[_Result, Derived]:
    result = _integrated(system, ts, None, q0, v0, settings)
    outputs, used = result.outputs, _baumgarte(result.stabilization)
    own = outputs.in_system()
    # XLA leaves out what nobody uses.
    multipliers = jax.vmap(lambda t, q, v, chart: multipliers_at(system, t, q, v, chart, used))(
        ts, own.q, own.v, own.chart
    )
    return result, Derived(multipliers, metric_of(system))


def _integrated(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    count: Int[Array, ""] | None,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> _Result:
    settings = settings.resolve(system, ts)
    run = integrate(system, ts, count, q0, v0, settings)
    if count is not None:
        # Rows that nobody asked for repeat the last one, which changes no judgement.
        rows = jnp.minimum(jnp.arange(len(ts)), count - 1)
        run = run._replace(outputs=jax.tree.map(lambda x: x[rows], run.outputs))
    start = differentiate(system.constraint, ts[0], *run.start)
    return _Result(
        run.outputs,
        start,
        judge_run(system, ts, run, start, settings),
        _flags(system, ts, run.outputs),
        run.steps,
        run.accepted,
        run.steps - run.accepted,
        settings.baumgarte or settings.projection,
    )


# Arrays of NumPy will do for it too.
_plain: Any = program(_integrated)


def _baumgarte(stabilization: Stabilization) -> Baumgarte | None:
    return stabilization if isinstance(stabilization, Baumgarte) else None


def _trajectory(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    run: _Result,
    derived: Derived | OnDemand,
    settings: Settings,
) -> Trajectory:
    controlled, frequencies = settings.dt is None, settings.frequencies
    statistics = Statistics(
        num_steps=run.steps,
        num_accepted_steps=run.accepted,
        num_rejected_steps=run.rejected,
        rtol=settings.rtol if controlled else None,
        atol=settings.atol if controlled else None,
        fastest_frequency=None if frequencies is None else frequencies.fastest,
        stabilization=run.stabilization,
    )
    return Trajectory(
        t=ts,
        q=run.outputs.q,
        v=run.outputs.v,
        violation=run.outputs.violation,
        derived=derived,
        stats=statistics,
        status=run.status,
        flags=run.flags,
        coordinates=system.full.structure.coordinates,
        solver_parts=Parts.of(settings.solver),
    )


def _flags(system: AbstractSystem, ts: Float[Array, " k"], outputs: Output) -> Int[Array, ""]:
    """What the system says against its own motion."""
    if system.validity is None:
        return jnp.zeros((), int)
    own = outputs.in_system()
    run = Run(ts, own.q, own.v, outputs.q, outputs.violation)
    return system.validity.flags(system, run)
