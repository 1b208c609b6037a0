"""The status of a run, decided from its states and outputs."""

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..common import precision
from ..system.base import AbstractSystem
from .integration import Integrated
from .settings import Settings
from .status import Status

# A joint whose violation exceeds this share of the mechanism's size has come apart, not drifted.
_APART = 1e-2
# A violation may be so many times the tolerance of the step size control, relative to the size.
_DRIFT = 10.0


def judge_run(
    system: AbstractSystem,
    run: Integrated,
    q0: Float[Array, " n"],
    fits: Bool[Array, ""],
    settings: Settings,
) -> Int[Array, ""]:
    """The status of a run, by its outputs and whether its start `fits` the constraints."""
    result = run.march.result
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
        (~fits, Status.INCONSISTENT_START),
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
        unresolved = ~_is_resolved(system, run.ts[0], q0, limits)
        ladder.insert(0, (unresolved, Status.PRECISION))
    places = system.structure.without_states(own.q)
    violated = ~_constraints_hold(places, own.violation, settings)
    ladder.append((violated, Status.CONSTRAINTS_VIOLATED))
    conditions = [condition for condition, _ in ladder]
    codes = [jnp.asarray(int(status)) for _, status in ladder]
    return jnp.select(conditions, codes, jnp.asarray(int(Status.SUCCESS)))


def _constraints_hold(
    q: Float[Array, "k n"], violation: Float[Array, " k"], settings: Settings
) -> Bool[Array, ""]:
    """Whether projection or Baumgarte's term has done what it can do; whatever the settings, no
    joint is as far apart as the mechanism is large.
    """
    size = jnp.max(jnp.abs(q), axis=1, initial=1.0)
    if not settings.holds_constraints:
        allowed = size[:1]
    elif settings.baumgarte is not None:
        # Stabilization holds the constraints only as well as the errors of the steps allow.
        allowed = _APART * size[0] + _DRIFT * drift_of(q, settings.rtol)
    else:
        allowed = precision.of(q.dtype).start_tolerance * size
    return jnp.all(violation <= allowed)


def drift_of(q: Float[Array, "k n"], rtol: ArrayLike) -> Float[Array, " k"]:
    """The violation that is no more than the tolerance of the step size control."""
    size = jnp.max(jnp.abs(q), axis=1, initial=1.0)
    return jnp.asarray(rtol) * size


def _is_resolved(
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
