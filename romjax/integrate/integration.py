"""The integration of the equations of motion."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float, Int

from ..common.errors import InputError
from ..events.check import check_quantities
from ..events.passage import Passage
from ..events.record import Events
from ..events.watch import Watch
from ..system.base import AbstractSystem
from ..system.consistent import project_start
from ..system.schedule import Schedule
from .audit import Audit, Auditor, Findings
from .dense import Pieces, output_of, post_step_of
from .march import March
from .outputs import Output
from .post_step import PostStep, PostStepSolver
from .reverse import Ended, differentiable_run, ended
from .settings import Settings
from .step_size import StepSizeControl
from .steps import Steps
from .term import ChartedMotionTerm, ChartedState, MotionTerm, State
from .tolerances import Tolerances


class Integrated(NamedTuple):
    """What an integration gives, whether it gets to its end or not."""

    outputs: Output
    start: tuple[Float[Array, " n"], Float[Array, " n"]]  # q and v, projected where all steps are
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    findings: Findings | None
    imbalance: Float[Array, " k"] | None
    ts: Float[Array, " k"]  # of the outputs: after a stop, its own
    events: Events | None
    pieces: Pieces | None  # of dense output


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
    post_step = post_step_of(system, settings.projection)
    if settings.projection is not None and settings.projects_start:
        q0, v0 = project_start(system, ts[0], q0, v0)
    term, solver, y0 = _problem(system, q0, v0, post_step, settings)
    tolerances = Tolerances.of(system.structure, settings.rtol, settings.atol, settings.follow)
    controller, first = _step_size_control(ts, settings, tolerances)

    output = output_of(system, settings.projection)
    if settings.adjoint is not None and not settings.is_forward:
        if settings.dt is None:
            corners = Schedule.of(system).corners(ts)
            if len(corners):
                controller = diffrax.ClipStepSizeController(controller, step_ts=corners)
        parts = term, solver, controller, first
        return _by_diffrax(parts, output, ts, (q0, v0), y0, settings)
    most, asked = settings.max_steps, jnp.asarray(len(ts) if count is None else count)
    watch = _watch(system, post_step, ts, settings, tolerances)
    # Dense output has room for so many steps.
    room = jnp.minimum(jnp.asarray(most), settings.dense) if settings.dense else jnp.asarray(most)
    steps = Steps(
        term=term,
        solver=solver,
        controller=controller,
        t0=ts[0],
        t1=ts[-1],
        dt0=first,
        max_steps=room,
        watch=watch,
        **_limits(system, post_step, ts, settings),
    )
    audit = None
    if settings.audit:
        controlled = settings.dt is None
        audit = Auditor(system, post_step, settings.baumgarte, tolerances, controlled).functions()
    run = _march(steps, output, ts, asked, y0, audit, settings)
    outputs, imbalance, times, events = run.outputs, run.imbalance, ts, None
    if watch is not None and run.record is not None and run.watching is not None:
        outputs, imbalance, times = _held(run, ts, output)
        events = watch.describe(run.record, run.watching)
    return Integrated(
        outputs=outputs,
        start=(q0, v0),
        result=run.result,
        steps=run.steps,
        accepted=run.accepted,
        findings=run.findings,
        imbalance=imbalance,
        ts=times,
        events=events,
        pieces=run.pieces,
    )


def _by_diffrax(
    parts: tuple[Any, Any, Any, Float[Array, ""]],
    output: Callable[[Array, Any], Output],
    ts: Float[Array, " k"],
    start: tuple[Float[Array, " n"], Float[Array, " n"]],
    y0: Any,
    settings: Settings,
) -> Integrated:
    """By the loop of diffrax, whose adjoint takes the derivatives.

    `parts`: the differential equation, the method, the step size control and the first step.
    """
    if settings.events or settings.dense:
        raise InputError(
            "simulate: events and dense=True need romjax's own integration, but the adjoint is "
            f"diffrax's "
            f"{type(settings.adjoint).__name__}; leave it out, use `with romjax.forward_mode():`, "
            "and within transformations an explicit solver or romjax.Rodas5P()."
        )
    assert settings.adjoint is not None
    term, solver, controller, first = parts
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
        outputs=outputs,
        start=start,
        result=solution.result,
        steps=stats["num_steps"],
        accepted=stats["num_accepted_steps"],
        findings=None,
        imbalance=None,
        ts=ts,
        events=None,
        pieces=None,
    )


def _watch(
    system: AbstractSystem,
    post_step: PostStep | None,
    ts: Float[Array, " k"],
    settings: Settings,
    tolerances: Tolerances,
) -> Watch | None:
    """What watches the events of a run; None where there are none."""
    if not settings.events:
        return None
    check_quantities(system, settings.events)
    return Watch(
        system=system,
        post_step=post_step,
        stabilization=settings.baumgarte,
        events=settings.events,
        tolerances=tolerances,
        end=ts[-1],
        span=ts[-1] - ts[0],
        most=settings.max_events,
    )


def _limits(
    system: AbstractSystem, post_step: PostStep | None, ts: Float[Array, " k"], settings: Settings
) -> dict[str, Any]:
    """What limits steps but for the errors in them, as `Steps` has it: contacts and loads; nothing
    limits fixed steps.
    """
    if settings.dt is not None:
        return {"passage": None, "schedule": None, "corners": None}
    schedule = Schedule.of(system).seeing(ts)
    corners = schedule.corners(ts)
    return {
        "passage": Passage.of(system, post_step, settings.baumgarte, settings.rtol),
        "schedule": schedule if schedule.limits_steps else None,
        "corners": corners if len(corners) else None,
    }


def _held(
    run: Ended, ts: Float[Array, " size"], output: Callable[[Array, Any], Output]
) -> tuple[Output, Float[Array, " size"] | None, Float[Array, " size"]]:
    """Outputs, imbalances and times, those after a stop as they are at the stop."""
    assert run.record is not None
    assert run.watching is not None
    last = jnp.maximum(run.record.number - 1, 0)
    t, y = jax.tree.map(lambda x: x[last], (run.record.time, run.record.after))
    held = run.watching.stopped & (jnp.arange(len(ts)) >= run.number)

    def hold(rows: Array, row: Array) -> Array:
        chosen: Array = jnp.where(held.reshape(-1, *[1] * row.ndim), row, rows)
        return chosen

    outputs: Output = jax.tree.map(hold, run.outputs, output(t, y))
    imbalance = run.imbalance
    if imbalance is not None and run.findings is not None:
        imbalance = hold(imbalance, run.findings.balance.imbalance)
    return outputs, imbalance, hold(ts, t)


def _march(
    steps: Steps,
    output: Callable[[Array, Any], Output],
    ts: Float[Array, " size"],
    asked: Int[Array, ""],
    y0: Any,
    audit: Audit | None,
    settings: Settings,
) -> Ended:
    """By romjax's own loop, which can be differentiated if its most steps are known."""
    most = settings.max_steps
    # A number that is known limits how many states a derivative may have to remember.
    known = most if isinstance(most, int) and not settings.is_forward else None
    if known is None:
        steps = steps.without_transpose()
    march = March(
        steps=steps,
        trial=steps.trial,
        output=output,
        ts=ts,
        asked=asked,
        meter=settings.meter,
        audit=audit,
        events=settings.max_events,
        dense=settings.dense,
    )
    start = steps.start(y0)
    return ended(march.run(start)) if known is None else differentiable_run(march, start, known)


def _problem(
    system: AbstractSystem,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    post_step: PostStep | None,
    settings: Settings,
) -> tuple[diffrax.AbstractTerm[Any, Any], diffrax.AbstractSolver[Any], State | ChartedState]:
    """The differential equation, the method, and the state that it starts from."""
    motion, solver = MotionTerm(system, settings.baumgarte), _with_tolerances(settings)
    if post_step is None:
        return motion, solver, (q0, v0)
    solver, chart = PostStepSolver(solver, post_step), post_step.start(system)
    if chart is None:
        return motion, solver, (q0, v0)
    return ChartedMotionTerm(motion, post_step), solver, (q0, v0, jnp.asarray(chart, q0.dtype))


def _with_tolerances(settings: Settings) -> diffrax.AbstractSolver[Any]:
    """The method; a root finder without tolerances of its own takes those of the run."""
    solver: diffrax.AbstractSolver[Any] = settings.solver
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        finder: Any = solver.root_finder
        if not isinstance(finder.rtol, float | jax.Array | np.ndarray):
            rtol, atol = jnp.asarray(settings.rtol), jnp.asarray(settings.atol)
            finder = dataclasses.replace(finder, rtol=rtol, atol=atol, norm=optimistix.rms_norm)
            solver = dataclasses.replace(solver, root_finder=finder)  # type: ignore[call-arg]
    return solver


def _step_size_control(
    ts: Float[Array, " k"], settings: Settings, tolerances: Tolerances
) -> tuple[diffrax.AbstractStepSizeController[Any, Any], Float[Array, ""]]:
    """How steps are chosen, and the first one."""
    if settings.dt is not None:
        return diffrax.ConstantStepSize(), jnp.asarray(settings.dt)
    # Time hardly advances by less; a motion that turns NaN rejects steps until it gets there.
    least = 4 * jnp.finfo(ts.dtype).eps * jnp.maximum(jnp.abs(ts[0]), jnp.abs(ts[-1]))
    # A short first step instead of diffrax's estimate, which would trace the acceleration twice
    # more; the step size control needs three steps to grow it a thousandfold.
    first = 1e-3 * tolerances.rtol**0.2 * (ts[-1] - ts[0])
    return StepSizeControl.of(tolerances, least), first
