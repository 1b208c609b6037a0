"""The status and the flags of a run, decided from its states and outputs."""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..common import precision
from ..march.steps import Progress
from ..march.tolerances import Extent
from ..system.base import AbstractSystem, Run
from ..system.flags import Flag
from ..system.stabilization import Stabilization
from ..system.start import Start
from .follow.phase import Phase
from .integration import Integrated
from .resolution import allowed_share, is_resolved
from .settings import Settings
from .status import Status

# Angles [rad] that are wrong by less are not told of, so that a smaller rtol is a cure; nor those
# below the second number in fixed steps, for which there is no tolerance.
_FINE, _OFF = 1e-4, 0.05
# In space, where the speed of a body that turns on and on depends on its energy and on its angular
# momentum, errors of methods of even order, which gain less energy than they err by, are so many
# times what it says.
_EVEN = 4.0
# A joint whose violation exceeds this share of the mechanism's size has come apart, not drifted.
_APART = 1e-2
# A violation may be so many times the tolerance of the step size control, relative to the size.
_DRIFT = 10.0


class Judgement(NamedTuple):
    """The verdict on a run.

    - `steps`: how many it took; `accepted`: of these.
    - `start`: the constraints there. `status`, `flags`: as `Trajectory` has them.
    - `atol`: the absolute tolerance of velocities. `stabilization`: that was used.
    """

    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    start: Start
    status: Int[Array, ""]
    flags: Int[Array, ""]
    atol: Float[Array, ""]
    stabilization: Stabilization


def judge(
    system: AbstractSystem,
    run: Integrated,
    end: Progress,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> Judgement:
    """The judgement of a run from the start (q0, v0), and of how it ended."""
    if known := settings.known_start(system):
        start = known.constraints
    else:
        start = Start.of(system, run.ts[0], q0, v0, precision.of(q0.dtype).start_tolerance)
    status = _status(system, run, end.result, q0, start, settings)
    extent = Extent.of(run.outputs.q, run.outputs.v)
    flags = _flags(system, run, end, extent, settings)
    if run.findings is not None:
        flags |= run.findings.flags | _phase_flag(system, run.findings.phase, settings)
    used = settings.baumgarte or settings.projection
    atol = _absolute(extent, settings)
    return Judgement(end.steps, end.accepted, start, status, flags, atol, used)


def with_mass(
    system: AbstractSystem, run: Integrated, judgement: Judgement
) -> tuple[Integrated, Judgement]:
    """A run whose masses were tracers when its scene was made, which refuses only numbers: failed,
    and its motion NaN, where they are negative.
    """
    outputs = run.outputs
    q = outputs.q[0]
    has_mass = system.full.state(run.ts[0], q, 0 * q).has_mass()
    if has_mass is None:
        return run, judgement
    # Masses that are zero or NaN leave no finite motion, and are told so.
    lacking = jnp.all(jnp.isfinite(q)) & ~has_mass
    status = jnp.where(lacking, int(Status.NEGATIVE_MASS), judgement.status)
    q, v = (jnp.where(lacking, jnp.nan, x) for x in (outputs.q, outputs.v))
    run = run._replace(outputs=outputs._replace(q=q, v=v))
    return run, judgement._replace(status=status)


def _status(
    system: AbstractSystem,
    run: Integrated,
    result: diffrax.RESULTS,
    q0: Float[Array, " n"],
    start: Start,
    settings: Settings,
) -> Int[Array, ""]:
    """The status of a run, by its outputs and the constraints at its start."""
    own = run.outputs.in_system()
    # The constraints may overflow where the drifted coordinates themselves are still finite.
    numbers = (own.q, own.v, run.outputs.violation)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(x)) for x in numbers]))
    # The first that applies is the status: causes come before their consequences. Numbers that
    # cannot be trusted and a wrong start spoil all that follows; what the solver reports explains
    # why numbers are not finite; and only finite ones tell whether the constraints hold.
    # Time hardly advances by less than the least step: a motion that turns NaN rejects steps until
    # it gets there.
    ladder: list[tuple[ArrayLike, Status]] = [
        (~(start.closed & start.fits), Status.INCONSISTENT_START),
        (result == diffrax.RESULTS.dt_min_reached, Status.NOT_FINITE),
        (result == diffrax.RESULTS.max_steps_reached, Status.MAX_STEPS),
        (result != diffrax.RESULTS.successful, Status.SOLVER_FAILED),
        (~finite, Status.NOT_FINITE),
    ]
    if run.events is not None:
        ladder.insert(1, (run.events.lasting, Status.CONTACT_LASTS))
        ladder.insert(1, (run.events.count > len(run.events.time), Status.MAX_EVENTS))
    limits = precision.of(q0.dtype).dependent_rows
    if limits is not None:
        unresolved = ~_resolves_rows(system, run.ts[0], q0, limits)
        ladder.insert(0, (unresolved, Status.PRECISION))
    places = system.structure.without_states(own.q)
    violated = ~_constraints_hold(places, own.violation, start.size, settings)
    ladder.append((violated, Status.CONSTRAINTS_VIOLATED))
    conditions = [condition for condition, _ in ladder]
    codes = [jnp.asarray(int(status)) for _, status in ladder]
    return jnp.select(conditions, codes, jnp.asarray(int(Status.SUCCESS)))


def _constraints_hold(
    q: Float[Array, "k n"],
    violation: Float[Array, " k"],
    apart: Float[Array, ""],
    settings: Settings,
) -> Bool[Array, ""]:
    """Whether projection or Baumgarte's term has done what it can do; whatever the settings, no
    joint is as far `apart` as the mechanism is large at the start.
    """
    size = jnp.max(jnp.abs(q), axis=1, initial=1.0)
    reach = jnp.minimum(size[0], apart)
    if not settings.holds_constraints:
        allowed = reach[None]
    elif settings.baumgarte is not None:
        # Stabilization holds the constraints only as well as the errors of the steps allow.
        allowed = _APART * reach + _DRIFT * drift_of(q, settings.rtol)
    else:
        allowed = precision.of(q.dtype).start_tolerance * size
    return jnp.all(violation <= allowed)


def drift_of(q: Float[Array, "k n"], rtol: ArrayLike) -> Float[Array, " k"]:
    """The violation that is no more than the tolerance of the step size control."""
    size = jnp.max(jnp.abs(q), axis=1, initial=1.0)
    return jnp.asarray(rtol) * size


def _flags(
    system: AbstractSystem,
    run: Integrated,
    end: Progress,
    extent: Extent,
    settings: Settings,
) -> Int[Array, ""]:
    """Return the system's flags for its motion, and that of tolerances too coarse for it."""
    ts, outputs = run.ts, run.outputs
    flags, drift = jnp.zeros((), int), jnp.zeros_like(ts)
    if settings.dt is None:
        drift = drift_of(system.full.structure.without_states(outputs.q), settings.rtol)
        # Steps see what lies between the outputs: after one period nothing seems to have moved.
        reach = end.controller_state[1] if system is system.full else None
        resolved = is_resolved(system, settings, outputs.q[0], extent, end.accepted, reach)
        flags = jnp.where(resolved, 0, int(Flag.RESOLUTION))
    full = system.full
    if full.validity is not None:
        motion = Run(ts, outputs.q, outputs.v, outputs.q, outputs.violation, drift)
        flags |= full.validity.flags(full, motion)
    if system is not full and system.validity is not None:
        own = outputs.in_system()
        motion = Run(ts, own.q, own.v, outputs.q, outputs.violation, drift)
        flags |= system.validity.flags(system, motion)
    return flags


def _phase_flag(
    system: AbstractSystem, phase: Phase | None, settings: Settings
) -> Int[Array, ""] | int:
    """The flag of a run whose bodies have turned too often for its tolerances."""
    if phase is None:
        return 0
    even = (settings.solver.order(None) or 0) % 2 == 0
    factor = _EVEN if even and system.full.structure.quaternions else 1.0
    controlled = jnp.maximum(_FINE, allowed_share(jnp.asarray(settings.rtol)))
    allowed = controlled if settings.dt is None else _OFF
    off = jnp.maximum(factor * phase.angle, jnp.maximum(phase.swing, phase.bounced))
    return (off > allowed) * int(Flag.PHASE)


def _absolute(extent: Extent, settings: Settings) -> Float[Array, ""]:
    """The absolute tolerance of velocities, which follows them unless it is given."""
    fastest = settings.rtol * jnp.minimum(jnp.max(extent.speed), 1)
    return jnp.where(settings.follow, jnp.minimum(fastest, settings.atol), settings.atol)


def _resolves_rows(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    limits: tuple[float, float],
) -> Bool[Array, ""]:
    """Whether this precision tells nearly dependent constraints from repeated ones.

    The singular values of C_q, with rows of unit length in the metric of M⁻¹, are zero for those
    that repeat others; none may lie between the two `limits`.
    """
    state = system.state(t, q, jnp.zeros_like(q))
    kkt = state.kkt()
    half = jnp.linalg.cholesky(system.mass(q))
    rows = jax.scipy.linalg.solve_triangular(half, state.jacobian().T, lower=True)
    scale = kkt.pattern.join_rows(kkt.scale)
    values = jnp.linalg.svd(rows * scale[None], compute_uv=False)
    return jnp.all((values < limits[0]) | (values > limits[1]))
