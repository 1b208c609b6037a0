"""How far forces and impulses move a mechanism out of its model, estimated along a run of that."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.compat import is_traced
from ..compiling.program import program
from ..events.base import AbstractEvent
from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.reduced import AbstractReducedSystem
from ..system.structure import without_names
from .reactions import lifted_acceleration
from .trajectory import Trajectory

# States of a run of which the force is looked at, states from which its departure is followed, as
# many impacts, and directions of it.
_SAMPLES, _STATES, _DIRECTIONS = 64, 8, 3
# Its multiples are at no distances that a motion could repeat itself in.
_GOLDEN = 0.6180339887498949
# Displacements below, relative to where a mechanism is, are of one at rest, and equilibria are
# known to less than what they are allowed to err by.
_AT_REST = 1e-6


class _Impacts(NamedTuple):
    """Impacts of a run: `t` (k,) [s], `q`, `jump` (k, n): where they happen and what they change
    velocities by; `impulse` (k, events): as `Events.impulse`.
    """

    t: Any
    q: Any
    jump: Any
    impulse: Any


def departure(
    system: AbstractReducedSystem, run: Trajectory, events: tuple[AbstractEvent, ...] = ()
) -> Any:
    """How far the mechanism departs from a `run` of its model that watched `events`, relative to
    the motion, in the metric of its mass.

    The model's acceleration â leaves the force Q − M â unbalanced, of which reactions of joints
    take a part. What they leave accelerates the mechanism out of its model, at

        M Δ + C_qᵀ λ = Q − M â,  C_q Δ = 0.

    A departure δ follows δ̈ = Δ − A δ with A = −∂q̈/∂q, which is symmetric in the metric of M at
    rest. Along an eigenvector of A it goes no further than Δ/ω², which a force that lasts moves it
    by, and no further than ∬ Δ dt², which Δ moves it by where nothing holds it. Of A are taken the
    three directions that begin with Δ (Lanczos), in which A is the tridiagonal matrix H, and
    f(A) Δ ≈ |Δ| V f(H) e₁ (Saad 1992, doi:10.1137/0729014).

    At an impact the impulse that the law of restitution asks of the mechanism, along that of the
    model, changes velocities by ε more than those of the model: δ goes no further than ε/ω, and ε
    times what is left of the run.

    It is an estimate: loads between the states that it sees, damping and turning are left out.
    """
    struck = _impacts(run, events)
    given: list[Any] = [run.t, run.q, run.v, run.metric]
    traced = any(is_traced(x) for x in given)
    t, q, v, metric = given if traced else [np.asarray(x) for x in given]
    xp: Any = jnp if traced else np
    # Of the way, and of where the mechanism is: a motion that is smaller is rounding of it.
    ways = xp.concatenate([q - q[:1], _AT_REST * (1 + xp.abs(q[:1]))])
    # States are picked outside of the program, which is then one for runs of any length: all of
    # few, and of many one of each part, at no equal distances.
    numbers = np.arange(_SAMPLES)
    within = _GOLDEN * numbers % 1 if len(t) > _SAMPLES else 0.0
    picked = ((numbers + within) * len(t) / _SAMPLES).astype(int)
    # Differences and sums of NumPy are no arrays.
    ends: Any = xp.asarray(t[np.array([0, -1])])
    size: Any = xp.sqrt(xp.max(xp.sum((ways @ metric) * ways, axis=1)))
    # Events ask for bodies and coordinates by their names.
    system = without_names(system) if struck is None else system
    watched = () if struck is None else events
    return _departure(
        system, ends, xp.asarray(size), (t[picked], q[picked], v[picked]), watched, struck
    )


def _impacts(run: Trajectory, events: tuple[AbstractEvent, ...]) -> _Impacts | None:
    """The impacts of a run that change velocities most; None where there are none."""
    record = run.events
    if record is None or not any(event.resets for event in events):
        return None
    rows = (record.time, record.q, record.v_before, record.v_after, record.impulse)
    used = record.is_impact
    traced = any(is_traced(x) for x in (*rows, used))
    if not traced and not np.any(used):
        return None
    xp: Any = jnp if traced else np
    t, q, before, after, impulse = (xp.asarray(x) for x in rows)
    given = _Impacts(t, q, after - before, impulse)
    sizes = xp.where(used, xp.sum(given.jump**2, axis=1), 0)
    # As many rows for runs with any number of impacts, of which those at the end change nothing.
    room = max(_STATES - len(t), 0)
    largest = xp.argsort(-sizes)[:_STATES]

    def rows_of(x: Any, other: Any) -> Any:
        mask = used[largest].reshape(-1, *[1] * (x.ndim - 1))
        other = xp.asarray(other, x.dtype)
        unused = xp.broadcast_to(other, (room, *x.shape[1:]))
        return xp.concatenate([xp.where(mask, x[largest], other), unused])

    return _Impacts(
        rows_of(given.t, xp.asarray(run.t)[-1]),
        rows_of(given.q, xp.asarray(run.q)[-1]),
        rows_of(given.jump, 0.0),
        rows_of(given.impulse, 0.0),
    )


@program
def _departure(
    system: AbstractReducedSystem,
    ends: Float[Array, "2"],
    size: Float[Array, ""],
    states: tuple[Float[Array, " k"], Float[Array, "k n"], Float[Array, "k n"]],
    events: tuple[AbstractEvent, ...],
    impacts: _Impacts | None,
) -> Float[Array, ""]:
    given = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x,
        (system, ends, size, states, events, impacts),
    )
    system, ends, size, states, events, impacts = given
    pushes, sizes = jax.lax.map(lambda x: _unbalanced(system, *x), states)
    # The largest of each part of the run.
    parts = sizes.reshape(_STATES, -1)
    largest = jnp.argmax(parts, axis=1) + parts.shape[1] * jnp.arange(_STATES)

    def by_forces(x: tuple[Array, ...]) -> Array:
        squares, directions, shares = _directions(system.full, size, *x)
        # The metric at the state in which these directions are.
        state = system.full.state(*x[:3])
        free = _integrated_twice(states[0], ends, multiply(pushes, state.apply_mass(directions)))
        held = shares / jnp.where(squares > 0, squares, 1)
        far: Array = jnp.linalg.norm(jnp.where(squares > 0, jnp.minimum(held, free), free))
        return far

    picked = jax.tree.map(lambda x: x[largest], (*states, pushes))
    departures = jax.lax.map(by_forces, picked)
    if impacts is not None:

        def by_impact(x: tuple[Array, ...]) -> Array:
            t, q, *_ = x
            start = t, q, jnp.zeros_like(q), _unmodelled_jump(system, events, *x)
            squares, _, shares = _directions(system.full, size, *start)
            left = ends[1] - t
            far: Array = jnp.linalg.norm(shares * jnp.minimum(jnp.sqrt(1 / squares), left))
            return far

        departures = jnp.concatenate([departures, jax.lax.map(by_impact, tuple(impacts))])
    # Nor does one that is singular beside it.
    largest_one: Array = jnp.nanmax(departures)
    return largest_one / size


def _unbalanced(
    system: AbstractReducedSystem, t: Array, q: Array, v: Array
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """What moves the mechanism out of its model at one state, Δ, and its size."""
    full = system.full
    state, modelled = full.state(t, q, v), lifted_acceleration(system, t, q, v)
    free = jnp.zeros(full.m, q.dtype)
    push = state.kkt().solve(-state.residual(modelled), free)[0]
    push = full.structure.without_states(push)
    # A singular state tells nothing.
    push = jnp.where(jnp.all(jnp.isfinite(push)), push, 0)
    return push, multiply(push, state.apply_mass(push))


def _unmodelled_jump(
    system: AbstractReducedSystem,
    events: tuple[AbstractEvent, ...],
    t: Array,
    q: Array,
    jump: Array,
    impulse: Array,
) -> Float[Array, " n"]:
    """What an impact of a model changes velocities of the mechanism by, beside the `jump` of the
    model.
    """
    full, none = system.full, jnp.zeros_like(q)

    def along(q: Array) -> Array:
        """The sum of the gaps of impacts, each times its impulse."""
        pairs = zip(events, impulse, strict=True)
        struck = [p * event.value(full, t, q, none) for event, p in pairs if event.resets]
        return jnp.sum(jnp.stack(struck))

    pull = jax.grad(along)(q)
    change = full.state(t, q, none).kkt().solve(pull, jnp.zeros(full.m, q.dtype))[0]
    seen = multiply(pull, change)
    ratio = jnp.where(seen > 0, multiply(pull, jump) / jnp.where(seen > 0, seen, 1), 0)
    return ratio * change - jump


def _directions(
    full: AbstractSystem, size: Array, t: Array, q: Array, v: Array, start: Array
) -> tuple[Float[Array, " d"], Float[Array, "n d"], Float[Array, " d"]]:
    """The squares of frequencies along the directions of a mechanism that begin with `start`, these
    directions, and the size of `start` along each.
    """
    state = full.state(t, q, v)
    # Difference quotients, of steps that are small in this motion: the derivative would double the
    # program for a rough number.
    step = jnp.cbrt(jnp.finfo(q.dtype).eps) * size

    def extend(k: Array, at: tuple[Array, ...]) -> tuple[Array, ...]:
        """Make direction `k`: `start`, and then of what A makes of the last one."""
        directions, products, first = at
        last = directions[k - 1]
        acceleration = solve(full, t, q + step * last, v, None).acceleration
        pushed = full.structure.without_states(first - acceleration)
        x = jnp.where(k == 0, start, pushed / step)
        along = multiply(directions, state.apply_mass(x))
        left = x - multiply(along, directions)
        long = jnp.sqrt(jnp.maximum(multiply(left, state.apply_mass(left)), 0))
        directions = directions.at[k].set(left / jnp.where(long > 0, long, 1))
        first = jnp.where(k == 0, acceleration, first)
        return directions, products.at[k].set(along.at[k].set(long)), first

    # A loop, not copies of the acceleration, which begins where no direction is.
    count = _DIRECTIONS + 1
    empty = jnp.zeros((count, full.n), q.dtype), jnp.zeros((count, count), q.dtype), q
    directions, products, _ = jax.lax.fori_loop(0, count, extend, empty)
    # Row k has H eₖ₋₁, and row 0 the size of `start`.
    squares, vectors = jnp.linalg.eigh(products[1:, :-1])
    shares = products[0, 0] * jnp.abs(vectors[0])
    return jnp.abs(squares), multiply(directions[:-1].T, vectors), shares


def _integrated_twice(
    t: Float[Array, " k"], ends: Float[Array, "2"], rates: Float[Array, "k d"]
) -> Float[Array, " d"]:
    """The largest double integral of accelerations that are known at some times of a run."""
    steps = jnp.diff(t, prepend=ends[:1], append=ends[1:])[:, None]
    # They go straight from one of these times to the next.
    begin, end = rates[jnp.array([0, *range(len(t))])], rates[jnp.array([*range(len(t)), -1])]
    speeds = jnp.cumsum(0.5 * steps * (begin + end), axis=0)
    before = jnp.concatenate([jnp.zeros_like(speeds[:1]), speeds[:-1]])
    ways = jnp.cumsum(steps * before + steps**2 * (2 * begin + end) / 6, axis=0)
    return jnp.max(jnp.abs(ways), axis=0)
