"""The run of a simulation: one compiled program, and the trajectory that its numbers are."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..common import compat
from ..common.partition import Partitioned
from ..compiling.lane_marks import marked
from ..compiling.program import program
from ..compiling.xla import filter_jit
from ..march.march import DENSE
from ..system.base import AbstractSystem
from ..system.consistent import project_start
from ..system.stabilization import Baumgarte, Projection, Stabilization
from ..system.start import Start
from .default import default_stabilization
from .dense import DenseOutput
from .derived import EagerQuantities, LazyQuantities, metric_of, multipliers_along
from .integration import AUDIT, MONITORS, STATES, Integrated, integrate
from .judge import Judgement, judge, with_mass
from .outputs import capacity, cut, with_room
from .settings import Settings
from .signature import signature
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
    integrated, judgement, derived = _run(system, bare, ts, q0, v0, settings)
    dense, interpolations = None, integrated.seen.get(DENSE)
    if interpolations is not None:
        parts = Partitioned.of(system)
        dense = DenseOutput(parts, judgement.stabilization, jnp.asarray(ts[0]), interpolations)
    trajectory = _trajectory(system, integrated, judgement, derived, dense, settings)
    return trajectory, judgement.start


def _run(
    system: AbstractSystem,
    bare: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Integrated, Judgement, EagerQuantities | LazyQuantities]:
    """The run, by a program of its own that others share, or as a part of the user's."""
    # Within a transformation of JAX the run is a part of the user's program: bases are of a given
    # rank there, and lanes would need much room, so that no states between the outputs are kept.
    if not compat.is_outermost():
        run, judgement, derived = _differentiable(bare, ts, q0, v0, settings.limited(traced=True))
        return run, judgement, derived
    settings = settings.limited(traced=False)
    states = _STATES if system.full is system else 0
    steps = np.asarray(settings.max_steps)
    settings = settings._replace(max_steps=steps, forward=False, states=states)
    count = len(ts)
    # Rows for the next power of two, so that other numbers of outputs need no other program.
    size = capacity(count, 2 * bare.full.n, q0.dtype)
    times = ts if size == count else with_room(ts, size)
    run, judgement = _plain(bare, times, np.asarray(count), q0, v0, settings)
    # After a stop only, times are others than those that were asked for.
    stopped = None if run.events is None else run.ts
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
        stabilization=_baumgarte(judgement.stabilization),
    )
    return run._replace(ts=ts, outputs=outputs, imbalance=imbalance), judgement, demand


@filter_jit
def _differentiable(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Integrated, Judgement, EagerQuantities]:
    # Rodas5P's batches gain nothing by it: it takes many directions through each lane at once.
    if isinstance(settings.solver, diffrax.AbstractERK):
        system, ts, q0, v0, settings = marked((system, ts, q0, v0, settings))
    run, judgement = _integrated(system, ts, None, q0, v0, settings)
    run, judgement = with_mass(system, run, judgement)
    used = _baumgarte(judgement.stabilization)
    own = run.outputs.in_system()
    # XLA leaves out what nobody uses.
    multipliers = multipliers_along(system, run.ts, own.q, own.v, own.chart, used)
    numbers = jnp.asarray(signature(system))
    return run, judgement, EagerQuantities(multipliers, metric_of(system), None, numbers)


def _integrated(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    count: Int[Array, ""] | None,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> tuple[Integrated, Judgement]:
    settings = settings._replace(stabilization=_stabilization(system, ts, settings))
    if settings.projection is not None and settings.projects_start:
        q0, v0 = project_start(system, ts[0], q0, v0)
    q0, v0 = ticked(system, ts[0], q0, v0)
    run, end = integrate(system, ts, count, q0, v0, settings)
    if count is not None:
        # Padding rows repeat the last one, so that they do not change what is judged here.
        rows = jnp.minimum(jnp.arange(len(ts)), count - 1)
        held = (run.ts, run.outputs, run.imbalance)
        ts, outputs, imbalance = jax.tree.map(lambda x: x[rows], held)
        run = run._replace(ts=ts, outputs=outputs, imbalance=imbalance)
    judgement = judge(system, run, end, q0, v0, settings)
    # Only some findings become results of the program; the others are in the run in another form.
    seen = {name: each for name, each in run.seen.items() if name in _RESULTS}
    if AUDIT in seen:
        seen[AUDIT] = jax.lax.stop_gradient(seen[AUDIT])
    imbalance = jax.lax.stop_gradient(run.imbalance)
    return run._replace(seen=seen, imbalance=imbalance), judgement


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
    run: Integrated,
    judgement: Judgement,
    derived: EagerQuantities | LazyQuantities,
    dense: DenseOutput | None,
    settings: Settings,
) -> Trajectory:
    controlled, frequencies = settings.dt is None, settings.frequencies
    findings, states = run.findings, run.seen.get(STATES)
    if states is not None:
        q, v, *_ = states.y
        states = StepStates(states.t, system.structure.with_states(q, v), v)
    statistics = compat.make_module(
        Statistics,
        num_steps=judgement.steps,
        num_accepted_steps=judgement.accepted,
        num_rejected_steps=judgement.steps - judgement.accepted,
        rtol=settings.rtol if controlled else None,
        atol=judgement.atol if controlled else None,
        fastest_frequency=None if frequencies is None else frequencies.fastest,
        stabilization=judgement.stabilization,
    )
    return compat.make_module(
        Trajectory,
        t=run.ts,
        q=run.outputs.q,
        v=run.outputs.v,
        violation=run.outputs.violation,
        derived=derived,
        stats=statistics,
        status=judgement.status,
        flags=judgement.flags,
        balance=None if findings is None else findings.balance,
        branching=None if findings is None else findings.branching,
        imbalance=run.imbalance,
        events=run.events,
        dense=dense,
        states=states,
        followed=run.seen.get(MONITORS, ()),
        coordinates=system.full.structure.coordinates,
        solver_parts=Partitioned.of(settings.solver),
    )
