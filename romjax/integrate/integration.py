"""The integration of the equations of motion, and what a user sees of its states."""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Float

from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.consistent import project, project_start
from ..system.constraints import ConstraintState
from ..system.dynamics import constraint_state
from .chart_change import ChartChange
from .post_step import PostStep, PostStepSolver, ProjectState, motion_norm
from .settings import Settings
from .term import ChartedMotionTerm, ChartedState, MotionTerm, State, acceleration


class States(NamedTuple):
    """Integrated states at the output times, in the coordinates of the system."""

    q: Float[Array, "k n"]
    v: Float[Array, "k n"]
    chart: Float[Array, " k"] | None  # of a system with charts: the one that q and v belong to
    start: tuple[Float[Array, " n"], Float[Array, " n"]]  # q and v, projected where all steps are
    result: diffrax.RESULTS
    stats: dict[str, Any]


class Outputs(NamedTuple):
    """What follows from the states, at the output times."""

    q: Float[Array, "k N"]  # physical
    v: Float[Array, "k N"]
    multipliers: Float[Array, "k m"]
    violation: Float[Array, " k"]
    constraints: ConstraintState


def post_step_of(system: AbstractSystem, settings: Settings) -> PostStep | None:
    """What changes the state after each step; None if nothing does."""
    if settings.projection is not None:
        return ProjectState(settings.projection.sweeps)
    return ChartChange.of(system) if has_charts(system) else None


def integrate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    post_step: PostStep | None,
    settings: Settings,
) -> States:
    """Integrate the equations of motion from the first to the last of `ts`, all as it is set.

    Never raises: how it went is in `result`.
    """
    if settings.projection is not None:
        q0, v0 = project_start(system, ts[0], q0, v0)
    motion = MotionTerm(system, settings.baumgarte)
    term: diffrax.AbstractTerm[Any, Any] = motion
    state: State | ChartedState = (q0, v0)
    solver = settings.solver
    chart = None if post_step is None else post_step.start(system)
    if post_step is not None:
        solver = PostStepSolver(solver, post_step)
    if chart is not None:
        term, state = ChartedMotionTerm(motion, post_step), (q0, v0, jnp.asarray(chart, q0.dtype))
    controller, first = _step_size_control(ts, settings, chart is not None)
    solution = diffrax.diffeqsolve(
        term,
        solver,
        t0=ts[0],
        t1=ts[-1],
        dt0=first,
        y0=state,
        saveat=diffrax.SaveAt(ts=ts),
        stepsize_controller=controller,
        adjoint=settings.adjoint,
        max_steps=settings.max_steps,
        progress_meter=settings.meter,
        throw=False,
    )
    assert solution.ys is not None
    q, v, *charts = solution.ys
    if settings.projection is not None:
        # Between steps, dense output leaves the constraints by about 1e-6.
        sweeps = settings.projection.sweeps
        q, v = jax.vmap(lambda t, q, v: project(system, t, q, v, sweeps))(ts, q, v)
    number = charts[0] if charts else None
    return States(q, v, number, (q0, v0), solution.result, solution.stats)


def _step_size_control(
    ts: Float[Array, " k"], settings: Settings, charted: bool
) -> tuple[diffrax.AbstractStepSizeController[Any, Any], Float[Array, ""]]:
    """How steps are chosen, and the first one."""
    rtol, atol, span = settings.rtol, settings.atol, ts[-1] - ts[0]
    if settings.dt is not None:
        return diffrax.ConstantStepSize(), settings.dt
    # Time hardly advances by less; a motion that turns NaN rejects steps until it gets there.
    least = 4 * jnp.finfo(ts.dtype).eps * jnp.maximum(jnp.abs(ts[0]), jnp.abs(ts[-1]))
    norm = motion_norm if charted else optimistix.rms_norm
    control = diffrax.PIDController(rtol=rtol, atol=atol, dtmin=least, force_dtmin=False, norm=norm)
    # A short first step instead of diffrax's estimate, which would trace the acceleration twice
    # more; the step size control needs three steps to grow it a thousandfold.
    return control, 1e-3 * rtol**0.2 * span


def evaluate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    states: States,
    post_step: PostStep | None,
    settings: Settings,
) -> Outputs:
    """Physical coordinates, multipliers and constraints of all states."""

    def at(t: Array, q: Array, v: Array, chart: Array | None) -> Outputs:
        local = system
        if chart is not None:
            assert post_step is not None
            local = post_step.in_chart(system, chart)
        _, multipliers = acceleration(local, t, q, v, settings.baumgarte)
        state = local.state(t, q, v)
        violation = jnp.max(jnp.abs(local.full.constraint(t, state.q)), initial=0.0)
        constraints = constraint_state(local, t, q, v)
        return Outputs(state.q, state.v, multipliers, violation, constraints)

    return jax.vmap(at)(ts, states.q, states.v, states.chart)
