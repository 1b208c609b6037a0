"""Simulation: the one way from a system to a trajectory."""

import warnings
from typing import Any, Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..arrays import Vector, as_array, concrete
from ..checks import check_finite, check_shape
from ..errors import SimulationError
from ..system.base import AbstractSystem
from ..system.consistent import START_TOLERANCE, check_start_shapes, project, project_start
from ..system.dynamics import constraint_state
from ..system.frequencies import Frequencies
from ..system.stabilization import Baumgarte, Projection, Stabilization
from .adjoint import default_adjoint
from .default import default_solver, default_stabilization, frequencies, warn_of_fast_stabilization
from .post_step import SettledSolver
from .rodas5p import Rodas5P
from .term import MotionTerm, acceleration
from .trajectory import REMEDIES, Status, Trajectory

# Joints are torn, not just drifting, where they are violated by so much of the mechanism's size.
_TORN = 1e-2


def simulate(
    system: AbstractSystem,
    ts: Vector,
    *,
    q0: Vector | None = None,
    v0: Vector | None = None,
    solver: diffrax.AbstractSolver | None = None,
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
      JAX traces: Rodas5P for flexible systems). `Trajectory.solver` says which.
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
    times = _check_times(ts)
    q, v = check_start_shapes(system, q0, v0)
    check_finite("simulate", "q0", q)
    check_finite("simulate", "v0", v)
    if q.dtype == jnp.float32:
        warnings.warn(
            "Simulating in single precision: expect errors from 1e-5. For double precision, call "
            'jax.config.update("jax_enable_x64", True) before making any array.',
            stacklevel=2,
        )
    rtol, times = jnp.asarray(rtol, q.dtype), times.astype(q.dtype)
    step = None if dt is None else jnp.asarray(dt, q.dtype)
    chosen = isinstance(stabilization, Baumgarte)
    found = None
    if solver is None or stabilization == "default":
        found = frequencies(system, times, q, v)
        if solver is None:
            solver = default_solver(system, times, step, found)
    trajectory, start = _simulate(
        system,
        times,
        q,
        v,
        solver=solver,
        rtol=rtol,
        atol=rtol if atol is None else jnp.asarray(atol, q.dtype),
        dt=step,
        stabilization=stabilization,
        frequencies=found,
        adjoint=default_adjoint() if adjoint is None else adjoint,
        max_steps=max_steps,
        meter=diffrax.TqdmProgressMeter() if progress else diffrax.NoProgressMeter(),
    )
    if chosen and not isinstance(solver, Rodas5P | diffrax.AbstractImplicitSolver):
        warn_of_fast_stabilization(system, trajectory, q, v)
    return _raise_failure(system, trajectory, start) if throw else trajectory


def _check_times(ts: Vector) -> Float[Array, " k"]:
    times = as_array(ts)
    check_shape("simulate", "ts", times, (None,))
    check_finite("simulate", "ts", times)
    known = concrete(times)
    if times.shape[0] < 2:
        raise ValueError(f"simulate: ts has {times.shape[0]} entries; give the start and the end.")
    if known is not None and not np.all(np.diff(known) > 0):
        place = int(np.argmin(np.diff(known)))
        raise ValueError(
            f"simulate: ts must increase, but ts[{place}] = {known[place]:g} is followed by "
            f"{known[place + 1]:g}."
        )
    return times


@eqx.filter_jit
def _simulate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    *,
    solver: diffrax.AbstractSolver,
    rtol: Float[Array, ""],
    atol: Float[Array, ""],
    dt: Float[Array, ""] | None,
    stabilization: Stabilization | Literal["default"],
    frequencies: Frequencies | None,
    adjoint: diffrax.AbstractAdjoint,
    max_steps: int,
    meter: diffrax.AbstractProgressMeter,
) -> tuple[Trajectory, Any]:
    if stabilization == "default":
        assert frequencies is not None
        stabilization = default_stabilization(system, ts, dt, frequencies)
    baumgarte = stabilization if isinstance(stabilization, Baumgarte) else None
    # None where there is nothing to project.
    projection = stabilization if isinstance(stabilization, Projection) and system.m else None
    settled = solver
    if projection:
        q0, v0 = project_start(system, ts[0], q0, v0)
        settled = SettledSolver(solver, eqx.Partial(project, sweeps=projection.sweeps))
    # A short first step instead of diffrax's estimate, which would trace the acceleration twice
    # more; the step size control needs three steps to grow it a thousandfold.
    first = 1e-3 * rtol**0.2 * (ts[-1] - ts[0]) if dt is None else dt
    # Time hardly advances by less; a motion that turns NaN rejects steps until it gets there.
    least = 4 * jnp.finfo(q0.dtype).eps * jnp.maximum(jnp.abs(ts[0]), jnp.abs(ts[-1]))
    solution = diffrax.diffeqsolve(
        MotionTerm(system, baumgarte),
        settled,
        t0=ts[0],
        t1=ts[-1],
        dt0=first,
        y0=(q0, v0),
        saveat=diffrax.SaveAt(ts=ts),
        stepsize_controller=(
            diffrax.PIDController(rtol=rtol, atol=atol, dtmin=least, force_dtmin=False)
            if dt is None
            else diffrax.ConstantStepSize()
        ),
        adjoint=adjoint,
        max_steps=max_steps,
        progress_meter=meter,
        throw=False,
    )
    assert solution.ys is not None
    q, v = solution.ys
    if projection:
        # Between steps, dense output leaves the constraints by about 1e-6.
        q, v = jax.vmap(lambda t, q, v: project(system, t, q, v, projection.sweeps))(ts, q, v)

    def evaluate(t, q, v):  # type: ignore[no-untyped-def]
        _, multipliers = acceleration(system, t, q, v, baumgarte)
        state = system.state(t, q, v)
        violation = jnp.max(jnp.abs(system.full.constraint(t, state.q)), initial=0.0)
        return state.q, state.v, multipliers, violation, constraint_state(system, t, q, v)

    physical_q, physical_v, multipliers, violation, states = jax.vmap(evaluate)(ts, q, v)
    start = jax.tree.map(lambda x: x[0], states)
    result = solution.result
    # Drift can be finite in q and past all numbers in C.
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(x)) for x in (q, v, violation)]))
    status = jnp.asarray(Status.SUCCESS)
    if projection or (baumgarte and dt is None and system.m):
        size = jnp.maximum(1.0, jnp.max(jnp.abs(q), axis=1))
        # Baumgarte's term holds them as far as the errors of the steps let it.
        drift = _TORN * size[0] + 10 * rtol * size
        allowed = drift if baumgarte else START_TOLERANCE[q0.dtype] * size
        left = jnp.max(jnp.abs(states.violation), axis=1, initial=0.0)
        status = jnp.where(jnp.all(left <= allowed), status, Status.JOINTS_PART)
    status = jnp.where(finite, status, Status.NOT_FINITE)
    status = jnp.where(result == diffrax.RESULTS.successful, status, Status.SOLVER_FAILED)
    status = jnp.where(result == diffrax.RESULTS.max_steps_reached, Status.MAX_STEPS, status)
    status = jnp.where(result == diffrax.RESULTS.dt_min_reached, Status.NOT_FINITE, status)
    status = jnp.where(_consistent(start, q0, v0), status, Status.INCONSISTENT_START)
    if q0.dtype == jnp.float32:
        status = jnp.where(_resolved(system, ts[0], q0), status, Status.PRECISION)
    stats = {
        key: solution.stats[key]
        for key in ("num_steps", "num_accepted_steps", "num_rejected_steps")
    }
    if dt is None:
        stats |= {"rtol": rtol, "atol": atol}
    if frequencies is not None:
        stats |= {"fastest_frequency": frequencies.fastest}
    if baumgarte is not None:
        stats |= {"alpha": baumgarte.alpha, "beta": baumgarte.beta}
    trajectory = Trajectory(
        t=ts,
        q=physical_q,
        v=physical_v,
        multipliers=multipliers,
        violation=violation,
        metric=system.full.mass(system.full.q0),
        stats=stats,
        status=status,
        doubt=jnp.zeros((), int)
        if system.validity is None
        else system.validity.flags(system, ts, q, v, physical_q, violation),
        labels=system.full.structure.labels,
        solver=type(solver).__name__,
    )
    return trajectory, start


def _consistent(start: Any, q0: Float[Array, " n"], v0: Float[Array, " n"]) -> Array:
    tolerance = START_TOLERANCE[q0.dtype]
    scale_q = jnp.maximum(1.0, jnp.max(jnp.abs(q0)))
    scale_v = jnp.maximum(1.0, jnp.max(jnp.abs(v0)))
    return jnp.all(jnp.abs(start.violation) <= tolerance * scale_q) & jnp.all(
        jnp.abs(start.rate) <= tolerance * scale_v
    )


def _resolved(system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]) -> Array:
    """Whether single precision tells nearly dependent constraints from repeated ones.

    The singular values of C_q, with rows of unit length in the metric of M⁻¹, are zero for those
    that repeat others; accelerations lose as many digits as their squares.
    """
    state = system.state(t, q, jnp.zeros_like(q))
    saddle = state.kkt()
    half = jnp.linalg.cholesky(system.mass(q))
    rows = jax.scipy.linalg.solve_triangular(half, state.jacobian().T, lower=True)
    scale = saddle.pattern.join_rows(saddle.scale)
    values = jnp.linalg.svd(rows * scale[None], compute_uv=False)
    return jnp.all((values < 1e-5) | (values > 1.5e-2))


def _raise_failure(system: AbstractSystem, trajectory: Trajectory, start: Any) -> Trajectory:
    status = concrete(trajectory.status)
    if status is None:
        failed = trajectory.status != Status.SUCCESS
        words = "; or ".join(remedy for remedy in REMEDIES.values() if remedy)
        q = eqx.error_if(trajectory.q, failed, f"A simulation failed: {words}.")
        return eqx.tree_at(lambda tr: tr.q, trajectory, q)
    if status == Status.INCONSISTENT_START:
        violation, rate = np.asarray(start.violation), np.asarray(start.rate)
        which, values, unit = ("C", violation, "m or rad")
        if np.max(np.abs(violation)) < np.max(np.abs(rate)):
            which, values, unit = ("its rate", rate, "m/s or rad/s")
        row = int(np.argmax(np.abs(values)))
        raise ValueError(
            f"simulate: the start violates {system.structure.constraints[row]}: {which} = "
            f"{values[row]:.6g} {unit}. Use q0, v0 = romjax.consistent(system, q0, v0)."
        )
    if status != Status.SUCCESS:
        steps = int(trajectory.stats["num_steps"])
        raise SimulationError(
            f"simulate: {trajectory.solver} took {steps} steps towards "
            f"t = {float(trajectory.t[-1]):g} s and failed: {trajectory.reason()}."
        )
    return trajectory
