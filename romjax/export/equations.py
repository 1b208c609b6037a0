"""The functions of a system that leave, each of its state x = (q, v)."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import precision
from ..integrate.judge import drift_of
from ..integrate.turning import turning
from ..system.base import AbstractSystem, Run
from ..system.dynamics import linearize, solve
from ..system.schedule import Schedule
from ..system.stabilization import Baumgarte
from ..system.start import Start

State = Float[Array, " x"]  # (q, v), of twice as many entries as there are coordinates


def baumgarte(system: AbstractSystem, numbers: Float[Array, "2"]) -> Baumgarte | None:
    """Baumgarte's terms of (α, β); none where nothing is constrained."""
    return Baumgarte(numbers[0], numbers[1]) if system.m else None


def rate(system: AbstractSystem, t: Array, x: State, stabilization: Array) -> Mapping[str, Array]:
    """The acceleration."""
    q, v = x[: system.n], x[system.n :]
    solved = solve(system, t, q, v, baumgarte(system, stabilization))
    return {"a": solved.acceleration}


def linear(system: AbstractSystem, t: Array, x: State, stabilization: Array) -> Mapping[str, Array]:
    """The acceleration and its derivatives."""
    q, v = x[: system.n], x[system.n :]
    slopes = linearize(system, t, q, v, baumgarte(system, stabilization))
    return {
        "a": slopes.acceleration,
        "by_q": slopes.by_position,
        "by_v": slopes.by_velocity,
        "by_t": slopes.by_time,
    }


def physical_output(system: AbstractSystem, t: Array, x: State) -> Mapping[str, Array]:
    """The physical coordinates and velocities, and the largest violations of the constraints, of
    the mechanism's and of the system's own.
    """
    q, v = x[: system.n], x[system.n :]
    state = system.state(t, q, v)
    constraints = system.full.constraint(t, state.q), system.constraint(t, q)
    violation = jnp.stack([jnp.max(jnp.abs(c), initial=0.0) for c in constraints])
    return {"q": state.q, "v": state.v, "violation": violation}


def start(system: AbstractSystem, t: Array, x: State, stabilization: Array) -> Mapping[str, Array]:
    """Whether the constraints hold, and their rates; the size of the mechanism, and how fast bodies
    turn.
    """
    q, v = x[: system.n], x[system.n :]
    state = Start.of(system, t, q, v, precision.of(q.dtype).start_tolerance)
    good = jnp.stack([state.closed, state.fits])
    speed = turning(system, t, q, v, baumgarte(system, stabilization))
    return {"good": good, "size": state.size, "turning": speed}


def judged_by_states(system: AbstractSystem) -> bool:
    """Whether single states tell something of the region of validity of a model, or of its full
    system.
    """
    regions = (x.validity for x in (system, system.full))
    return any(region is not None and region.of_states is not None for region in regions)


def flags(system: AbstractSystem, t: Array, x: State, rtol: Array) -> Mapping[str, Array]:
    """Return the flags of one state, by that part of the regions of validity which it tells; of two
    regions those of the reduced model, unless it has none.
    """
    q, v = x[: system.n], x[system.n :]
    output = physical_output(system, t, x)
    physical, rates = output["q"][None], output["v"][None]
    violation, drift = output["violation"][:1], drift_of(physical, rtol)
    motions = [(system, q[None], v[None])]
    if system is not system.full:
        motions.append((system.full, physical, rates))
    told = jnp.zeros((), int)
    for judged, own, own_rates in motions:
        if judged.validity is not None and (region := judged.validity.of_states) is not None:
            run = Run(t[None], own, own_rates, physical, violation, drift)
            told = jnp.where(told == 0, region.flags(judged, run), told)
    return {"flags": told}


def own_start(system: AbstractSystem) -> Mapping[str, Array]:
    """The state at the start."""
    return {"start": jnp.concatenate([system.q0, system.v0])}


def corners(system: AbstractSystem) -> Mapping[str, Array]:
    """The times at which steps have to end, infinite ones for none."""
    return {"times": Schedule.of(system).corners(jnp.zeros(0))}


def longest(schedule: Schedule, t: Array) -> Mapping[str, Array]:
    """The longest step that still sees all loads."""
    return {"longest": schedule.longest_step(t)}


def words(system: Any) -> dict[str, list[str]]:
    """Name the entries of a state, for comments."""
    labels = [coordinate.label for coordinate in system.structure.coordinates]
    full = [coordinate.label for coordinate in system.full.structure.coordinates]
    return {
        "x": [*labels, *(f"{label}'" for label in labels)],
        "a": [f"{label}''" for label in labels],
        "q": full,
        "v": [f"{label}'" for label in full],
    }
