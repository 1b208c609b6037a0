"""How far forces move a mechanism out of its reduced model, estimated along a run of the model."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import concrete
from ..common.compat import is_traced
from ..common.outside import outside_of_traces
from ..compiling.program import program_once
from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from ..system.dynamics import jacobian, solve
from ..system.flags import Flag
from ..system.reduced import AbstractReducedSystem
from ..system.structure import without_names
from ..system.training import Training
from .reactions import lifted_acceleration
from .trajectory import Trajectory

# States of a run that are looked at, from its start to its end, and directions of its departure.
_STATES, _DIRECTIONS = 16, 3
# Displacements below, relative to where a mechanism is, are rounding errors of one at rest.
_REST = 1e-10
# A row of constraints that leaves less than this of its length to those before it repeats them.
_REPEATED = 1e-9


def leaves_out(training: Training) -> bool:
    """Whether the mechanism has freedoms that its model has not, counted once at the start."""
    if training.leaves_out is None:
        rom = without_names(training.rom)

        def count() -> None:
            training.leaves_out = _freedoms(rom, rom.time) < _freedoms(rom.full, rom.time, rom)

        outside_of_traces(count)
    return bool(training.leaves_out)


def _freedoms(system: AbstractSystem, t: Array, rom: AbstractReducedSystem | None = None) -> int:
    """The freedoms that constraints of a system leave at its start, or at that of its model."""
    structure = system.structure
    # The length of a quaternion is no freedom, and neither is a state of an effect.
    count = system.n - len(structure.quaternions) - len(structure.states)
    if not system.m:
        return count
    rows = np.asarray(_rows(system, t, rom))
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = rows / np.where(lengths > 0, lengths, 1)
    return count - int(np.linalg.matrix_rank(rows, tol=_REPEATED))


@program_once
def _rows(
    system: AbstractSystem, t: Array, rom: AbstractReducedSystem | None
) -> Float[Array, "m n"]:
    q = system.q0 if rom is None else rom.reconstruct(t, rom.q0, rom.v0)[0]
    return jacobian(system, t, q)


def flag_departure(system: AbstractReducedSystem, run: Trajectory, limit: Any, tried: Any) -> Any:
    """`Flag.UNMODELLED` where the mechanism departs from a run by more than a `limit`; zero of runs
    that somebody has `tried`.
    """
    if concrete(tried) is None:
        far = jax.lax.cond(
            tried, lambda: jnp.zeros((), run.q.dtype), lambda: departure(system, run)
        )
    else:
        far = 0.0 if tried else departure(system, run)
    if is_traced(far) or is_traced(limit):
        return jnp.where(far > limit, int(Flag.UNMODELLED), 0)
    return int(Flag.UNMODELLED) if far > limit else 0


def departure(system: AbstractReducedSystem, run: Trajectory) -> Any:
    """How far the mechanism departs from a `run` of its model, relative to the motion, in the
    metric of its mass.

    The model's acceleration â leaves the force Q − M â unbalanced, of which reactions of joints
    take a part. What they leave accelerates the mechanism out of its model, at

        M Δ + C_qᵀ λ = Q − M â,  C_q Δ = 0.

    A departure δ follows δ̈ = Δ − A δ with A = −∂q̈/∂q, which is symmetric in the metric of M at
    rest. Along an eigenvector of A a force that lasts moves it by Δ/ω², or by Δ T²/2 where nothing
    holds it for the time T of the run: δ = f(A) Δ, f(ω²) = 1 / max(|ω²|, 2/T²). Of A are taken the
    three directions that begin with Δ (Lanczos), in which A is the tridiagonal matrix H, and
    f(A) Δ ≈ |Δ| V f(H) e₁ (Saad 1992, doi:10.1137/0729014). It is an estimate: loads between the
    states that it sees, damping and turning are left out.
    """
    # States are picked outside of the program, which is then one for runs of any length.
    picked = np.linspace(0, len(run.t) - 1, _STATES).astype(int)
    states: list[Any] = [x[picked] for x in (run.t, run.q, run.v)]
    if not any(is_traced(x) for x in states):
        states = [np.asarray(x) for x in states]
    return _departure(without_names(system), *states)


@program_once
def _departure(
    system: AbstractReducedSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> Float[Array, ""]:
    system, t, q, v = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, (system, t, q, v)
    )
    span, way = t[-1] - t[0], q - q[:1]
    moved = jax.lax.map(lambda x: _size(system, x[0], x[1]), (q, way))
    at_rest = _REST * _size(system, q[0], 1 + jnp.abs(q[0]))
    size = jnp.maximum(jnp.max(moved), at_rest)
    departures = jax.lax.map(lambda x: _departure_at(system, span, size, *x), (t, q, v))
    return jnp.max(departures) / size


def _size(system: AbstractReducedSystem, q: Array, x: Array) -> Array:
    """The size of a vector of the mechanism in the metric of its mass at q."""
    return jnp.sqrt(jnp.maximum(multiply(x, system.full.state(0.0, q, x).apply_mass(x)), 0))


def _departure_at(
    system: AbstractReducedSystem, span: Array, size: Array, t: Array, q: Array, v: Array
) -> Array:
    """The departure by what is unbalanced at one state, in a motion of a `size`."""
    full = system.full
    state = full.state(t, q, v)
    moves = jnp.ones_like(q).at[np.array(full.structure.states, int)].set(0)
    a, _, kkt = solve(full, t, q, v, None)
    unbalanced = -state.residual(lifted_acceleration(system, t, q, v))
    delta = moves * kkt.solve(unbalanced, jnp.zeros(full.m, q.dtype))[0]

    def length(x: Array) -> Array:
        return jnp.sqrt(jnp.maximum(multiply(x, state.apply_mass(x)), 0))

    def unit(x: Array, long: Array) -> Array:
        return x / jnp.where(long > 0, long, 1)

    # Difference quotients, of steps that are small in this motion: the derivative would double the
    # program for a rough number.
    step = jnp.cbrt(jnp.finfo(q.dtype).eps) * size

    def extend(k: int, at: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        directions, diagonal, side = at
        x = directions[k]
        pushed = moves * (a - solve(full, t, q + step * x, v, None).acceleration) / step
        along = multiply(directions, state.apply_mass(pushed))
        left = pushed - multiply(along, directions)
        long = length(left)
        directions = directions.at[k + 1].set(unit(left, long), mode="drop")
        return directions, diagonal.at[k].set(along[k]), side.at[k].set(long)

    long, empty = length(delta), jnp.zeros(_DIRECTIONS, q.dtype)
    directions = jnp.zeros((_DIRECTIONS, full.n), q.dtype).at[0].set(unit(delta, long))
    # A loop, not three copies of the acceleration.
    _, diagonal, side = jax.lax.fori_loop(0, _DIRECTIONS, extend, (directions, empty, empty))
    squares, vectors = jnp.linalg.eigh(
        jnp.diag(diagonal) + jnp.diag(side[:-1], 1) + jnp.diag(side[:-1], -1)
    )
    moved: Array = long * jnp.linalg.norm(vectors[0] / jnp.maximum(jnp.abs(squares), 2 / span**2))
    return moved
