"""Simulation: the one way from a system to a trajectory."""

import warnings
from typing import Any, Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ..arrays import Vector
from ..checks import check_finite
from ..errors import InputError
from ..system.base import AbstractSystem, Run
from ..system.consistent import check_start_shapes
from ..system.constraints import ConstraintState
from ..system.stabilization import Baumgarte, Stabilization
from .adjoint import default_adjoint
from .default import default_solver, start_frequencies, warn_of_fast_stabilization
from .failures import raise_failure
from .integration import Outputs, States, evaluate, integrate, post_step_of
from .judge import judge_run
from .rodas5p import Rodas5P
from .settings import Settings, check_times
from .statistics import Statistics
from .trajectory import SolverParts, Trajectory


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

    Compiled once for each structure: new numbers, tolerances and times of the same count
    recompile nothing. Works under `jit`, `vmap`, `grad`, and `jacfwd` with
    `adjoint=diffrax.ForwardMode()`.

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
    - `adjoint`: how derivatives are taken; reverse mode with checkpoints unless given, or inside
      `with romjax.forward_mode():`.
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
    if q.dtype == jnp.float32:
        warnings.warn(
            "Simulating in single precision: expect errors from 1e-5. For double precision, call "
            'jax.config.update("jax_enable_x64", True) before making any array.',
            stacklevel=2,
        )
    if isinstance(adjoint, diffrax.BacksolveAdjoint):
        raise InputError(
            "simulate: adjoint=BacksolveAdjoint() integrates the motion backwards in time, where "
            "dampers and the stabilisation of the constraints make it grow; use "
            "diffrax.RecursiveCheckpointAdjoint() or diffrax.ForwardMode()."
        )
    rtol, times = jnp.asarray(rtol, q.dtype), times.astype(q.dtype)
    step = None if dt is None else jnp.asarray(dt, q.dtype)
    frequencies = None
    if solver is None or stabilization == "default":
        frequencies = start_frequencies(system, times, q, v)
        if solver is None:
            solver = default_solver(system, times, step, frequencies)
    settings = Settings(
        solver=solver,
        rtol=rtol,
        atol=rtol if atol is None else jnp.asarray(atol, q.dtype),
        dt=step,
        stabilization=stabilization,
        frequencies=frequencies,
        adjoint=default_adjoint() if adjoint is None else adjoint,
        max_steps=max_steps,
        meter=diffrax.TqdmProgressMeter() if progress else diffrax.NoProgressMeter(),
    )
    trajectory, start = _simulate(system, times, q, v, settings)
    chosen = isinstance(stabilization, Baumgarte)
    if chosen and not isinstance(solver, Rodas5P | diffrax.AbstractImplicitSolver):
        warn_of_fast_stabilization(system, trajectory, q, v)
    return raise_failure(system, trajectory, start) if throw else trajectory


@eqx.filter_jit
def _simulate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Trajectory, ConstraintState]:
    """The trajectory, and the constraints at its start."""
    settings = settings.resolve(system, ts)
    post_step = post_step_of(system, settings)
    states = integrate(system, ts, q0, v0, post_step, settings)
    outputs = evaluate(system, ts, states, post_step, settings)
    trajectory = Trajectory(
        t=ts,
        q=outputs.q,
        v=outputs.v,
        multipliers=outputs.multipliers,
        violation=outputs.violation,
        metric=system.full.mass(system.full.q0),
        stats=_statistics(states, settings),
        status=judge_run(system, ts, states, outputs, settings),
        flags=_flags(system, ts, states, outputs),
        coordinates=system.full.structure.coordinates,
        solver_parts=SolverParts.of(settings.solver),
    )
    return trajectory, jax.tree.map(lambda x: x[0], outputs.constraints)


def _statistics(states: States, settings: Settings) -> Statistics:
    controlled, frequencies = settings.dt is None, settings.frequencies
    return Statistics(
        num_steps=states.stats["num_steps"],
        num_accepted_steps=states.stats["num_accepted_steps"],
        num_rejected_steps=states.stats["num_rejected_steps"],
        rtol=settings.rtol if controlled else None,
        atol=settings.atol if controlled else None,
        fastest_frequency=None if frequencies is None else frequencies.fastest,
        stabilization=settings.baumgarte or settings.projection,
    )


def _flags(
    system: AbstractSystem, ts: Float[Array, " k"], states: States, outputs: Outputs
) -> Int[Array, ""]:
    """What the system says against its own motion."""
    if system.validity is None:
        return jnp.zeros((), int)
    run = Run(ts, states.q, states.v, outputs.q, outputs.violation)
    return system.validity.flags(system, run)
