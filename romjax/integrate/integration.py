"""The integration of the equations of motion."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..events.check import check_quantities
from ..events.passage import Passage
from ..events.record import Events
from ..events.watch import Watch
from ..march.follower import AbstractFollower
from ..march.interpolations import InterpolationFollower
from ..march.march import DENSE, EVENTS, OUTPUTS, March
from ..march.outputs import Outputs, Saved
from ..march.progress_bar import ProgressBar
from ..march.record import RecordFollower
from ..march.reverse import differentiable_run
from ..march.states import StateFollower
from ..march.step_size import StepSizeControl
from ..march.steps import Progress, Steps
from ..march.tolerances import Tolerances
from ..system.base import AbstractSystem
from ..system.schedule import Schedule
from .amplitudes import amplitude_shares
from .between import interpolation_of
from .dense import output_of, post_step_of
from .follow.audit import Audit, Findings
from .follow.monitor import AbstractMonitor, MonitorFollower
from .outputs import Output
from .post_step import PostStep, PostStepSolver
from .settings import Settings
from .term import ChartedMotionTerm, ChartedState, MotionTerm, State
from .ticks import UntilTick, ticks
from .turning import for_turns
from .whole_implicit import WholeImplicit, takes_two_terms

# Keys of the followers that are not differentiated.
AUDIT, MONITORS, PROGRESS, STATES = "audit", "monitors", "progress", "states"


class Integrated(NamedTuple):
    """An integration, whether it got to its end or not.

    - `seen`: what its followers have seen, by names.
    - `ts`, `outputs`, `imbalance`: those that were asked for, after a stop as they are there.
    - `events`: what happened, in words of the mechanism.
    """

    seen: dict[str, Any]
    ts: Float[Array, " k"]
    outputs: Output
    imbalance: Float[Array, " k"] | None
    events: Events | None

    @property
    def findings(self) -> Findings | None:
        """The findings of the audit; None for a run without one."""
        return self.seen.get(AUDIT)


def integrate(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    count: Int[Array, ""] | None,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Integrated, Progress]:
    """Integrate the equations of motion from the first to the last of `ts`, all as it is set, and
    tell how far that got.

    `count`: how many of `ts` are asked for; None for all.

    Never raises: its progress says how it ended.
    """
    post_step = post_step_of(system, settings.projection)
    of_steps = for_turns(system, post_step, ts, q0, v0, settings)
    term, solver, y0 = _problem(system, q0, v0, post_step, of_steps)
    shares = None if settings.dt is not None else amplitude_shares(system, q0)
    # What a run is judged by is what was asked for, however often its bodies turn.
    asked_for, tolerances = (_tolerances(system, x, shares) for x in (settings, of_steps))
    controller, first = _step_size_control(ts, settings, tolerances)
    watch = _watch(system, post_step, ts, settings, tolerances)
    corners, longest, passage = _limits(system, post_step, ts, settings)
    most = jnp.asarray(settings.max_steps)
    # The end of the run is a constant: outputs there have derivatives by its time through the
    # motion within the last step.
    steps = Steps(
        term=term,
        solver=solver,
        interpolation=interpolation_of(solver),
        controller=controller,
        t0=ts[0],
        t1=jax.lax.stop_gradient(ts[-1]),
        dt0=first,
        # Dense output has room for this number of steps only.
        max_steps=jnp.minimum(most, settings.dense) if settings.dense else most,
        watch=watch,
        passage=passage,
        longest=UntilTick.of(system, longest),
        corners=corners,
    )
    # If the largest number of steps is known, reverse mode can reserve room for their states.
    known = settings.max_steps if isinstance(settings.max_steps, int) else None
    if known is None or settings.forward:
        known, steps = None, steps.without_transpose()
    start = steps.start(y0)
    others = _followers(system, post_step, asked_for, steps, start, settings)
    asked = jnp.asarray(len(ts) if count is None else count)
    output = output_of(system, settings.projection)
    outputs = Outputs(output, ts, asked, _imbalance if settings.audit else None)
    march = March(steps, steps.trial, outputs, others)
    if known is None:
        end, seen = march.run(start, march.before(start))
    else:
        end, seen = differentiable_run(march, start, known)
    seen[MONITORS] = tuple(seen[name] for name in _names_of(settings.monitors))
    saved: Saved = seen[OUTPUTS]
    run = Integrated(seen, ts, saved.rows, saved.beside, None)
    if watch is None or end.watching is None:
        return run, end
    held = end.watching.stopped & (jnp.arange(len(ts)) >= saved.number)
    events = watch.describe(seen[EVENTS], end.watching)
    return _hold_after_stop(run._replace(events=events), held, output), end


def _tolerances(
    system: AbstractSystem, settings: Settings, shares: Float[Array, " n"] | None
) -> Tolerances:
    """Return the tolerances of a system's coordinates and velocities."""
    structure, given = system.structure, (settings.rtol, settings.atol, settings.follow)
    return Tolerances.of(structure.is_position, *given, structure.is_state, shares)


def _limits(
    system: AbstractSystem,
    post_step: PostStep | None,
    ts: Float[Array, " k"],
    settings: Settings,
) -> tuple[
    Float[Array, " c"] | None, Callable[[Float[Array, ""]], Float[Array, ""]] | None, Passage | None
]:
    """Return the corners of loads, the longest step, and what steps must not pass; None for each
    that there is not.
    """
    if settings.dt is not None:  # nothing limits fixed steps but the ticks of controllers
        return None, None, None
    schedule = Schedule.of(system).seeing(ts)
    corners = schedule.corners(ts)
    return (
        corners if len(corners) else None,
        schedule.longest_step if schedule.limits_steps else None,
        Passage.of(system, post_step, settings.baumgarte, settings.rtol),
    )


def _followers(
    system: AbstractSystem,
    post_step: PostStep | None,
    tolerances: Tolerances,
    steps: Steps,
    start: Progress,
    settings: Settings,
) -> dict[str, AbstractFollower]:
    """Return the followers beside the outputs; those not asked for are no part of the program."""
    followers: dict[str, AbstractFollower] = {}
    if settings.audit:
        controlled = settings.dt is None
        known = settings.known_start(system)
        # The known energy of a system in charts is that of the chart in which the run begins.
        energy = None if known is None or post_step is not None else known.energy
        followers[AUDIT] = Audit(
            system, post_step, settings.baumgarte, tolerances, controlled, energy
        )
    if settings.events:
        followers[EVENTS] = RecordFollower(settings.max_events)
    if settings.dense:
        step = start.y, start.solver_state, start.watching, start.t, start.next_t
        between = eqx.filter_eval_shape(steps.trial, *step).between
        followers[DENSE] = InterpolationFollower(settings.dense, between)
    if settings.states and steps.passage is not None:
        followers[STATES] = StateFollower(settings.states)
    for name, monitor in _names_of(settings.monitors).items():
        followers[name] = MonitorFollower(system, post_step, monitor)
    if not isinstance(settings.meter, diffrax.NoProgressMeter):
        followers[PROGRESS] = ProgressBar(settings.meter, steps.t0, steps.t1)
    return followers


def _names_of(monitors: tuple[AbstractMonitor, ...]) -> dict[str, AbstractMonitor]:
    """Return the monitors by the names that messages give them."""
    return {f"follow[{i}] ({type(each).__name__})": each for i, each in enumerate(monitors)}


def _imbalance(seen: Mapping[str, Any]) -> Float[Array, ""]:
    findings: Findings = seen[AUDIT]
    return findings.balance.imbalance


def _watch(
    system: AbstractSystem,
    post_step: PostStep | None,
    ts: Float[Array, " k"],
    settings: Settings,
    tolerances: Tolerances,
) -> Watch | None:
    """Return the watch for the events of a run; None where there are none."""
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
        ticks=ticks(system),
    )


def _hold_after_stop(
    run: Integrated,
    held: Bool[Array, " k"],
    output: Callable[[Float[Array, ""], PyTree], Output],
) -> Integrated:
    """Return a run with the times, outputs and imbalances that are `held` as they are at a stop."""
    record = run.seen[EVENTS]
    last = jnp.maximum(record.number - 1, 0)
    t, y = jax.tree.map(lambda x: x[last], (record.time, record.after))

    def hold(rows: Array, row: Array) -> Array:
        chosen: Array = jnp.where(held.reshape(-1, *[1] * row.ndim), row, rows)
        return chosen

    outputs = jax.tree.map(hold, run.outputs, output(t, y))
    imbalance = None if run.imbalance is None else hold(run.imbalance, _imbalance(run.seen))
    return run._replace(ts=hold(run.ts, t), outputs=outputs, imbalance=imbalance)


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
    return WholeImplicit(solver) if takes_two_terms(solver) else solver


def _step_size_control(
    ts: Float[Array, " k"], settings: Settings, tolerances: Tolerances
) -> tuple[diffrax.AbstractStepSizeController[Any, Any], Float[Array, ""]]:
    """Return the step size control and the first step."""
    if settings.dt is not None:
        return diffrax.ConstantStepSize(), jnp.asarray(settings.dt)
    # Time hardly advances by less; a motion that turns NaN rejects steps until it gets there.
    least = 4 * jnp.finfo(ts.dtype).eps * jnp.maximum(jnp.abs(ts[0]), jnp.abs(ts[-1]))
    # A short first step instead of diffrax's estimate, which would trace the acceleration twice
    # more; the step size control needs three steps to grow it a thousandfold.
    first = 1e-3 * tolerances.rtol**0.2 * (ts[-1] - ts[0])
    return StepSizeControl.of(tolerances, least), first
