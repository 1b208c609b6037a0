"""The integration of the equations of motion."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Float, Int

from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.consistent import project, project_start
from .chart_change import ChartChange
from .march import March
from .outputs import Output, output_at
from .post_step import PostStep, PostStepSolver, ProjectState, motion_norm
from .reverse import Ended, differentiable_run, ended
from .settings import Settings
from .steps import Steps
from .term import ChartedMotionTerm, ChartedState, MotionTerm, State


class Integrated(NamedTuple):
    """What an integration gives, whether it gets to its end or not."""

    outputs: Output
    start: tuple[Float[Array, " n"], Float[Array, " n"]]  # q and v, projected where all steps are
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]


def post_step_of(system: AbstractSystem, settings: Settings) -> PostStep | None:
    """What changes the state after each step; None if nothing does."""
    if settings.projection is not None:
        return ProjectState(settings.projection.sweeps)
    return ChartChange.of(system) if has_charts(system) else None


def integrate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    count: Int[Array, ""] | None,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> Integrated:
    """Integrate the equations of motion from the first to the last of `ts`, all as it is set.

    `count`: how many of `ts` are asked for; None for all.

    Never raises: how it went is in `result`.
    """
    post_step = post_step_of(system, settings)
    if settings.projection is not None:
        q0, v0 = project_start(system, ts[0], q0, v0)
    term, solver, y0 = _problem(system, q0, v0, post_step, settings)
    controller, first = _step_size_control(ts, settings, len(y0) == 3)

    def output(t: Array, y: Any) -> Output:
        if settings.projection is not None:
            # Between steps, dense output leaves the constraints by about 1e-6.
            q, v = y
            y = project(system, t, q, v, settings.projection.sweeps)
        saved: Output = output_at(system, post_step, t, y)
        return saved

    if settings.adjoint is None:
        most, asked = settings.max_steps, jnp.asarray(len(ts) if count is None else count)
        steps = Steps(term, solver, controller, ts[0], ts[-1], first, jnp.asarray(most))
        run = _march(steps, output, ts, asked, y0, settings)
        return Integrated(run.outputs, (q0, v0), run.result, run.steps, run.accepted)
    solution = diffrax.diffeqsolve(
        term,
        solver,
        t0=ts[0],
        t1=ts[-1],
        dt0=first,
        y0=y0,
        saveat=diffrax.SaveAt(ts=ts),
        stepsize_controller=controller,
        adjoint=settings.adjoint,
        max_steps=settings.max_steps,
        progress_meter=settings.meter,
        throw=False,
    )
    outputs, stats = jax.vmap(output)(ts, solution.ys), solution.stats
    return Integrated(
        outputs, (q0, v0), solution.result, stats["num_steps"], stats["num_accepted_steps"]
    )


def _march(
    steps: Steps,
    output: Callable[[Array, Any], Output],
    ts: Float[Array, " size"],
    asked: Int[Array, ""],
    y0: Any,
    settings: Settings,
) -> Ended:
    """By romjax's own loop, which can be differentiated if its most steps are known."""
    most = settings.max_steps
    if not isinstance(most, int):
        steps = steps.without_transpose()
    march, start = March(steps, steps.trial, output, ts, asked, settings.meter), steps.start(y0)
    if isinstance(most, int):
        return differentiable_run(march, start, most)
    return ended(march.run(start))


def _problem(
    system: AbstractSystem,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    post_step: PostStep | None,
    settings: Settings,
) -> tuple[diffrax.AbstractTerm[Any, Any], diffrax.AbstractSolver[Any], State | ChartedState]:
    """The differential equation, the method, and the state that it starts from."""
    motion, solver = MotionTerm(system, settings.baumgarte), settings.solver
    if post_step is None:
        return motion, solver, (q0, v0)
    solver, chart = PostStepSolver(solver, post_step), post_step.start(system)
    if chart is None:
        return motion, solver, (q0, v0)
    return ChartedMotionTerm(motion, post_step), solver, (q0, v0, jnp.asarray(chart, q0.dtype))


def _step_size_control(
    ts: Float[Array, " k"], settings: Settings, charted: bool
) -> tuple[diffrax.AbstractStepSizeController[Any, Any], Float[Array, ""]]:
    """How steps are chosen, and the first one."""
    rtol, atol, span = jnp.asarray(settings.rtol), jnp.asarray(settings.atol), ts[-1] - ts[0]
    if settings.dt is not None:
        return diffrax.ConstantStepSize(), jnp.asarray(settings.dt)
    # Time hardly advances by less; a motion that turns NaN rejects steps until it gets there.
    least = 4 * jnp.finfo(ts.dtype).eps * jnp.maximum(jnp.abs(ts[0]), jnp.abs(ts[-1]))
    norm = motion_norm if charted else optimistix.rms_norm
    control = diffrax.PIDController(rtol=rtol, atol=atol, dtmin=least, force_dtmin=False, norm=norm)
    # A short first step instead of diffrax's estimate, which would trace the acceleration twice
    # more; the step size control needs three steps to grow it a thousandfold.
    return control, 1e-3 * rtol**0.2 * span
