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
from ..compiling.program import program, program_once
from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from ..system.dynamics import jacobian, solve
from ..system.flags import Flag
from ..system.reduced import AbstractReducedSystem
from ..system.structure import without_names
from ..system.training import Training
from .reactions import lifted_acceleration
from .trajectory import Trajectory

# States of a run that are looked at, and directions of its departure.
_STATES, _DIRECTIONS = 8, 3
# Its multiples are at no distances that a motion could repeat itself in.
_GOLDEN = 0.6180339887498949
# Displacements below, relative to where a mechanism is, are of one at rest, and equilibria are
# known to less than what they are allowed to err by.
_AT_REST = 1e-6
# A row of constraints that leaves less than this of its length to those before it repeats them.
_REPEATED = 1e-9


def has_fewer_freedoms(training: Training) -> bool:
    """Whether the mechanism has freedoms that its model has not, counted once at the start."""
    if training.has_fewer_freedoms is None:
        rom = without_names(training.rom)

        def count() -> None:
            training.has_fewer_freedoms = _freedoms(rom, rom.time) < _freedoms(
                rom.full, rom.time, rom
            )

        outside_of_traces(count)
    return bool(training.has_fewer_freedoms)


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
    given: list[Any] = [run.t, run.q, run.v, run.metric]
    traced = any(is_traced(x) for x in given)
    t, q, v, metric = given if traced else [np.asarray(x) for x in given]
    xp: Any = jnp if traced else np
    # Of the way, and of where the mechanism is: a motion that is smaller is rounding of it.
    ways = xp.concatenate([q - q[:1], _AT_REST * (1 + xp.abs(q[:1]))])
    # States are picked outside of the program, which is then one for runs of any length.
    picked = np.sort((_GOLDEN * np.arange(_STATES) % 1 * len(t)).astype(int))
    # Differences and sums of NumPy are no arrays.
    span: Any = xp.asarray(t[-1] - t[0])
    size: Any = xp.sqrt(xp.max(xp.sum((ways @ metric) * ways, axis=1)))
    return _departure(
        without_names(system), span, xp.asarray(size), t[picked], q[picked], v[picked]
    )


@program
def _departure(
    system: AbstractReducedSystem,
    span: Float[Array, ""],
    size: Float[Array, ""],
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> Float[Array, ""]:
    given = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x,
        (system, span, size, t, q, v),
    )
    system, span, size, *states = given
    departures = jax.lax.map(lambda x: _departure_at(system, span, size, *x), tuple(states))
    # A singular state tells nothing.
    largest: Array = jnp.nanmax(departures)
    return largest / size


def _departure_at(
    system: AbstractReducedSystem, span: Array, size: Array, t: Array, q: Array, v: Array
) -> Array:
    """The departure by what is unbalanced at one state, in a motion of a `size`."""
    full = system.full
    state, modelled = full.state(t, q, v), lifted_acceleration(system, t, q, v)
    moves = jnp.ones_like(q).at[np.array(full.structure.states, int)].set(0)
    free = jnp.zeros(full.m, q.dtype)
    # Difference quotients, of steps that are small in this motion: the derivative would double the
    # program for a rough number.
    step = jnp.cbrt(jnp.finfo(q.dtype).eps) * size

    def extend(k: Array, at: tuple[Array, ...]) -> tuple[Array, ...]:
        """Make direction `k`: of what is unbalanced, and then of what A makes of the last one."""
        directions, products, first = at
        last = directions[k - 1]
        solved = solve(full, t, q + step * last, v, None)
        delta = moves * solved.kkt.solve(-state.residual(modelled), free)[0]
        pushed = moves * (first - solved.acceleration) / step
        x = jnp.where(k == 0, delta, pushed)
        along = multiply(directions, state.apply_mass(x))
        left = x - multiply(along, directions)
        long = jnp.sqrt(jnp.maximum(multiply(left, state.apply_mass(left)), 0))
        directions = directions.at[k].set(left / jnp.where(long > 0, long, 1))
        first = jnp.where(k == 0, solved.acceleration, first)
        return directions, products.at[k].set(along.at[k].set(long)), first

    # A loop, not copies of the acceleration, which begins where no direction is.
    count = _DIRECTIONS + 1
    empty = jnp.zeros((count, full.n), q.dtype), jnp.zeros((count, count), q.dtype), q
    _, products, _ = jax.lax.fori_loop(0, count, extend, empty)
    # Row k has H eₖ₋₁, and row 0 the size of Δ.
    tridiagonal = products[1:, :-1]
    squares, vectors = jnp.linalg.eigh(tridiagonal)
    far: Array = jnp.linalg.norm(vectors[0] / jnp.maximum(jnp.abs(squares), 2 / span**2))
    far *= products[0, 0]
    return far
