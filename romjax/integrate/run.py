"""The run of a simulation: one compiled program, and the trajectory that its numbers are."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..common import compat, precision
from ..common.partition import Partitioned
from ..compiling.program import program
from ..compiling.xla import filter_jit
from ..march.march import DENSE
from ..march.tolerances import Extent
from ..system.base import AbstractSystem, Run
from ..system.consistent import project_start
from ..system.flags import Flag
from ..system.stabilization import Baumgarte, Projection, Stabilization
from ..system.start import Start
from .adjoint import has_root_finder
from .default import default_stabilization
from .dense import DenseOutput
from .derived import EagerQuantities, LazyQuantities, metric_of, multipliers_along
from .integration import AUDIT, MONITORS, STATES, Integrated, integrate
from .judge import drift_of, judge_run
from .outputs import Output, capacity, cut, with_room
from .resolution import is_resolved
from .settings import Settings
from .statistics import Statistics
from .step_states import StepStates
from .ticks import ticked
from .trajectory import Trajectory


def run(
    system: AbstractSystem,
    bare: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Trajectory, Start]:
    """The trajectory of a system that is `bare` of names, and the constraints at its start."""
    result, derived = _run(system, bare, ts, q0, v0, settings)
    dense, pieces = None, result.run.march.seen.get(DENSE)
    if pieces is not None:
        dense = DenseOutput(
            Partitioned.of(system), result.stabilization, jnp.asarray(ts[0]), pieces
        )
    return _trajectory(system, result, derived, dense, settings), result.start


class _Result(NamedTuple):
    """The result of a run without names."""

    run: Integrated
    start: Start
    status: Int[Array, ""]
    flags: Int[Array, ""]
    atol: Float[Array, ""]
    stabilization: Stabilization


def _run(
    system: AbstractSystem,
    bare: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[_Result, EagerQuantities | LazyQuantities]:
    """The run, by a program of its own that others share, or as a part of the user's."""
    traced = not compat.is_outermost()
    settings = settings.limited(traced)
    # Within a transformation bases are of a given rank, and lanes would need much room.
    states = _STATES if system.full is system else 0
    if not traced:
        steps = np.asarray(settings.max_steps)
        settings = settings._replace(max_steps=steps, forward=False, states=states)
    # A root finder contains functions, which are no part of a stored program.
    if traced or has_root_finder(settings.solver):
        result, derived = _differentiable(bare, ts, q0, v0, settings)
        return result, derived if traced else derived._replace(parts=Partitioned.of(system))
    count = len(ts)
    size = capacity(count, 2 * bare.full.n, q0.dtype)
    times = ts if size == count else with_room(ts, size)
    result = _plain(bare, times, np.asarray(count), q0, v0, settings)
    # After a stop only, times are others than those that were asked for.
    run, stopped = result.run, None if result.run.events is None else result.run.ts
    outputs, imbalance, stopped = cut((run.outputs, run.imbalance, stopped), count)
    ts = ts if stopped is None else stopped
    own = outputs.in_system()
    demand = compat.make_module(
        LazyQuantities,
        parts=Partitioned.of(system),
        t=ts,
        q=own.q,
        v=own.v,
        chart=own.chart,
        stabilization=_baumgarte(result.stabilization),
    )
    run = run._replace(ts=ts, outputs=outputs, imbalance=imbalance)
    return result._replace(run=run), demand


@filter_jit
def _differentiable(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[_Result, EagerQuantities]:
    result = _integrated(system, ts, None, q0, v0, settings)
    run, used = result.run, _baumgarte(result.stabilization)
    own = run.outputs.in_system()
    # XLA leaves out what nobody uses.
    multipliers = multipliers_along(system, run.ts, own.q, own.v, own.chart, used)
    return result, EagerQuantities(multipliers, metric_of(system))


def _integrated(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    count: Int[Array, ""] | None,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> _Result:
    settings = settings._replace(stabilization=_stabilization(system, ts, settings))
    if settings.projection is not None and settings.projects_start:
        q0, v0 = project_start(system, ts[0], q0, v0)
    q0, v0 = ticked(system, ts[0], q0, v0)
    run = integrate(system, ts, count, q0, v0, settings)
    if count is not None:
        # Padding rows repeat the last one, so that they do not change what is judged here.
        rows = jnp.minimum(jnp.arange(len(ts)), count - 1)
        held = (run.ts, run.outputs, run.imbalance)
        ts, outputs, imbalance = jax.tree.map(lambda x: x[rows], held)
        run = run._replace(ts=ts, outputs=outputs, imbalance=imbalance)
    if known := settings.known_start(system):
        start = known.constraints
    else:
        start = Start.of(system, ts[0], q0, v0, precision.of(q0.dtype).start_tolerance)
    status = judge_run(system, run, q0, start.closed & start.fits, settings)
    extent = Extent.of(run.outputs.q, run.outputs.v)
    flags = _flags(system, run.ts, run.outputs, extent, run.march.accepted, settings)
    if run.findings is not None:
        flags |= run.findings.flags
    # Only some findings become results of the program; the others are in the run in another form.
    seen = {name: each for name, each in run.march.seen.items() if name in _RESULTS}
    if AUDIT in seen:
        seen[AUDIT] = jax.lax.stop_gradient(seen[AUDIT])
    march = run.march._replace(result=None, watching=None, seen=seen)
    run = run._replace(march=march, imbalance=jax.lax.stop_gradient(run.imbalance))
    atol, stabilization = _absolute(extent, settings), settings.baumgarte
    return _Result(run, start, status, flags, atol, stabilization or settings.projection)


def _stabilization(
    system: AbstractSystem, ts: Float[Array, " k"], settings: Settings
) -> Stabilization:
    """The stabilization, chosen where none is given; there is no projection of no constraints."""
    given = settings.stabilization
    if given == "default":
        assert settings.frequencies is not None
        return default_stabilization(system, ts, settings.dt, settings.frequencies)
    return None if isinstance(given, Projection) and system.m == 0 else given


# How many states at the ends of steps are saved at most: an odd number, as thinning needs.
_STATES = 1025
# Followers whose findings are results of a run as they are.
_RESULTS = AUDIT, DENSE, MONITORS, STATES
# Arrays of NumPy will do for it too.
_plain: Any = program(_integrated)


def _baumgarte(stabilization: Stabilization) -> Baumgarte | None:
    return stabilization if isinstance(stabilization, Baumgarte) else None


def _trajectory(
    system: AbstractSystem,
    result: _Result,
    derived: EagerQuantities | LazyQuantities,
    dense: DenseOutput | None,
    settings: Settings,
) -> Trajectory:
    controlled, frequencies = settings.dt is None, settings.frequencies
    run, march, findings = result.run, result.run.march, result.run.findings
    states = march.seen.get(STATES)
    statistics = compat.make_module(
        Statistics,
        num_steps=march.steps,
        num_accepted_steps=march.accepted,
        num_rejected_steps=march.steps - march.accepted,
        rtol=settings.rtol if controlled else None,
        atol=result.atol if controlled else None,
        fastest_frequency=None if frequencies is None else frequencies.fastest,
        stabilization=result.stabilization,
    )
    return compat.make_module(
        Trajectory,
        t=run.ts,
        q=run.outputs.q,
        v=run.outputs.v,
        violation=run.outputs.violation,
        derived=derived,
        stats=statistics,
        status=result.status,
        flags=result.flags,
        balance=None if findings is None else findings.balance,
        branching=None if findings is None else findings.branching,
        imbalance=run.imbalance,
        events=run.events,
        dense=dense,
        states=None if states is None else StepStates(states.t, *states.y),
        followed=march.seen.get(MONITORS, ()),
        coordinates=system.full.structure.coordinates,
        solver_parts=Partitioned.of(settings.solver),
    )


def _absolute(extent: Extent, settings: Settings) -> Float[Array, ""]:
    """The absolute tolerance of velocities, which follows them unless it is given."""
    fastest = settings.rtol * jnp.minimum(jnp.max(extent.speed), 1)
    return jnp.where(settings.follow, jnp.minimum(fastest, settings.atol), settings.atol)


def _flags(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    outputs: Output,
    extent: Extent,
    steps: Int[Array, ""],
    settings: Settings,
) -> Int[Array, ""]:
    """Return the system's flags for its motion, and that of tolerances too coarse for it."""
    flags, drift = jnp.zeros((), int), jnp.zeros_like(ts)
    if settings.dt is None:
        drift = drift_of(system.full.structure.without_states(outputs.q), settings.rtol)
        resolved = is_resolved(system, settings, outputs.q[0], extent, steps)
        flags = jnp.where(resolved, 0, int(Flag.RESOLUTION))
    full = system.full
    if full.validity is not None:
        run = Run(ts, outputs.q, outputs.v, outputs.q, outputs.violation, drift)
        flags |= full.validity.flags(full, run)
    if system is not full and system.validity is not None:
        own = outputs.in_system()
        run = Run(ts, own.q, own.v, outputs.q, outputs.violation, drift)
        flags |= system.validity.flags(system, run)
    return flags
