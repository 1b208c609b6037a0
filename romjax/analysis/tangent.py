"""Small motions of a constrained mechanism about a state, in coordinates of its tangent space."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..assembly.assembled import controllers_of
from ..common.arrays import Time
from ..common.errors import InputError
from ..linalg import quaternions
from ..linalg.dense import multiply
from ..system import unit_length
from ..system.base import AbstractSystem
from ..system.constraints import differentiate
from ..system.dynamics import linearize as derivatives_of_acceleration
from .independent import scaled_rows


class Tangent(NamedTuple):
    """The linear equations ẋ = A x of small motions, x = (ζ, η), about a state.

    The states near (q, v) that satisfy the constraints are δq = N ζ, δv = N η + P ζ: the columns of
    N (n, d) span the null space of C_q, and P = −C_q⁺ ∂(C_q v + C_t)/∂q N keeps Ċ = 0, with the
    pseudoinverse in the metric of M. Along solutions of the equations of motion they stay there, so
    with a(t, q, v), the acceleration of the constrained mechanism, and N that is carried along the
    motion by Ṅ = P,

        ζ̇ = η,  η̇ = G⁻¹ Nᵀ M ((∂a/∂q N + ∂a/∂v P − Ṗ) ζ + ∂a/∂v N η),  G = Nᵀ M N.

    As NᵀM P = 0 all along, −NᵀM Ṗ = PᵀM P + NᵀṀ P. At an equilibrium P = 0, and
    −G⁻¹ Nᵀ M ∂a/∂q N is the stiffness of the mechanism with that of its joint forces. No eigenvalue
    of A belongs to the constraints.

    Of a mechanism in space, p·δp = 0 and p·δv + v·δp = 0 for each quaternion p with the rate v: its
    length moves nothing, so that it is no freedom. A change of it is in the null space of C_q, and
    orthogonal to all others in the metric of M, so that it is taken out of N and of P one by one.

    In a frame that turns with the angular velocity Ω about the origin, as a steadily turning
    mechanism is seen to rest, rates lose J δq and J δv, with J = Ω (∂/∂φ of a turn).
    """

    matrix: Float[Array, "two_d two_d"]
    basis: Float[Array, "n d"]  # N
    correction: Float[Array, "n d"]  # P
    dual: Float[Array, "d n"]  # G⁻¹ Nᵀ M


def refuse_slips(owner: str, system: AbstractSystem, moving: bool) -> None:
    """Raise InputError, beginning with `owner`, for small motions about one that is `moving`, with
    constraints of velocities: there they leave more freedoms in places than in velocities.
    """
    structure = system.full.structure
    if moving and structure.slips:
        raise InputError(
            f"{owner}: {structure.constraints[structure.slips[0]]} holds velocities, so that small "
            "motions are known at rest alone; leave out v."
        )


def refuse_clocks(owner: str, system: AbstractSystem) -> None:
    """Raise InputError, beginning with `owner`, for controllers that act at their ticks alone: the
    equations of motion know what they hold, and not their laws.
    """
    controllers = controllers_of(system)
    if controllers:
        name = controllers[0].sampled.name
        raise InputError(
            f"{owner}: the controller '{name}' acts at its ticks, which equations of motion do not "
            "have; ask the scene without it and without what it drives, or put its law in as an "
            "effect, such as a PID."
        )


def tangent_of(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    independent: int,
    turning: Float[Array, "n n"] | None = None,
) -> Tangent:
    """The small motions of a `system` with so many `independent` constraints about (t, q, v).

    `turning`: the J of a turning frame.
    """
    t = jnp.asarray(t, q.dtype)
    state = system.state(t, q, v)
    start = _null_space(system, t, q, independent)
    kkt = state.kkt()
    # The projection of a fixed basis onto the null space depends smoothly on all numbers, where
    # the vectors of a singular value decomposition do not.
    # KKT with the force M N₀ and γ = 0 projects N₀ orthogonally in the metric of M.
    zero = jnp.zeros((system.m, start.shape[1]), q.dtype)
    basis = unit_length.with_lengths(system, q, kkt.solve(state.apply_mass(start), zero)[0])

    def rate(q: Array) -> Array:
        return differentiate(system.constraint, t, q, v).rate

    change = jax.vmap(lambda x: jax.jvp(rate, (q,), (x,))[1], 1, 1)(basis)
    # A change of position by N z turns the directions that velocities may have: C_q P = −∂Ċ/∂q N.
    correction = kkt.solve(jnp.zeros_like(basis), -change)[0]
    correction = unit_length.with_lengths(system, q, correction, _along(system, v, basis))
    weighted = state.apply_mass(basis).T
    dual = jnp.linalg.solve(multiply(weighted, basis), weighted)
    slopes = derivatives_of_acceleration(system, t, q, v)
    by_position = multiply(slopes.by_position, basis) + multiply(slopes.by_velocity, correction)
    by_velocity = multiply(slopes.by_velocity, basis)
    d = basis.shape[1]
    drift = jnp.zeros((d, d), q.dtype)
    if turning is not None:
        drift = -multiply(dual, multiply(turning, basis))
        by_position -= multiply(turning, correction)
        by_velocity -= multiply(turning, basis)
    by_place = multiply(dual, by_position)
    if turning is None:  # N and P stand still as seen from a turning frame
        by_place += jnp.linalg.solve(
            multiply(weighted, basis), _carried(system, t, q, v, basis, correction)
        )
    rows = (
        [drift, jnp.eye(d, dtype=q.dtype)],
        [
            by_place,
            multiply(dual, by_velocity),
        ],
    )
    return Tangent(jnp.block([list(row) for row in rows]), basis, correction, dual)


def _carried(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    basis: Float[Array, "n d"],
    correction: Float[Array, "n d"],
) -> Float[Array, "d d"]:
    """−NᵀM Ṗ, of directions that turn with a motion. It is zero at rest and computed there too,
    since a program does not know the numbers of v.
    """

    def weighted(t: Array, q: Array) -> Array:
        return system.state(t, q, v).apply_mass(correction)

    metric, rate = jax.jvp(weighted, (t, q), (jnp.ones_like(t), v))
    return multiply(correction.T, metric) + multiply(basis.T, rate)


def _along(
    system: AbstractSystem, v: Float[Array, " n"], basis: Float[Array, "n d"]
) -> Float[Array, "bodies d"] | None:
    """p·δv = −v·δp of each quaternion."""
    if not system.structure.quaternions:
        return None
    table = quaternions.columns(system.structure.quaternions)
    return -jnp.sum(v[table][:, :, None] * basis[table], axis=1)


def _null_space(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], independent: int
) -> Float[Array, "n d"]:
    """A basis of what C_q and lengths leave free, orthonormal in the metric of M; a constant."""
    # The rows are C_q L⁻ᵀ with M = L Lᵀ: vectors that are orthonormal there are so in the kinetic
    # energy.
    rows, half = jax.lax.stop_gradient(scaled_rows(system, t, q))
    structure = system.structure
    moving = np.flatnonzero(~structure.is_state)
    _, _, right = jnp.linalg.svd(rows[:, moving], full_matrices=True)
    free = right[independent + len(structure.quaternions) :].T
    if structure.states:
        # No constraint knows of states, each of which is a direction by itself, after all others.
        own = np.eye(system.n)[:, np.array(structure.states)]
        wide = jnp.zeros((system.n, free.shape[1]), q.dtype).at[moving].set(free)
        free = jnp.concatenate([wide, jnp.asarray(own, q.dtype)], axis=1)
    basis: Float[Array, "n d"] = jax.scipy.linalg.solve_triangular(half, free, lower=True, trans=1)
    return basis
