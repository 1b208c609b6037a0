"""Which constraints of a mechanism do not repeat others, and whether a state agrees with them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import concrete
from ..common.compat import is_traced
from ..common.errors import InputError
from ..common.outside import outside_of_traces
from ..compiling.program import program_once
from ..system import unit_length
from ..system.base import AbstractSystem
from ..system.mobility import moves
from ..system.start import Start

# A state contradicts the constraints that it violates by more than this share of the mechanism's
# size, of which loose tolerances leave less.
_CONTRADICTS = 1e-3
# Singular values of C_q, with rows of unit length in the metric of M⁻¹, below this are zero.
_ZERO = 1e-8


def independent_constraints(
    owner: str,
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"] | None,
) -> tuple[int, Float[Array, " n"]]:
    """How many constraints do not repeat others, without the lengths of quaternions, and q.

    While JAX traces, they are as many as at the start of a system whose numbers are known, of
    others all; and the q that is returned raises an error where there are more or fewer. Raises
    InputError, beginning with `owner`, if these leave no freedom, or if the state contradicts them.
    `v`: None in a turning frame, with which the ground turns, too.
    """
    if system.m == 0:
        return 0, q
    singular, state = _constraints(system, t, q, jnp.zeros_like(q) if v is None else v)
    values, lengths = concrete(singular), len(system.structure.quaternions)
    if values is not None:
        _check_state(owner, system, state, v is not None)
        return int(np.sum(values > _ZERO)) - lengths, q
    count = _independent_at_start(system, t)
    if count is None and unit_length.freedoms(system) <= 0:
        raise InputError(
            f"{owner}: {system.m} constraints on {system.n} coordinates leave no freedom, unless "
            "some of them repeat others; while JAX traces, it is unknown how many do. Take these "
            "out, or call it without a transformation."
        )
    if count is None and not system.structure.loops:
        return system.m, q
    count = system.m + lengths if count is None else count
    others = jnp.any(singular[:count] <= _ZERO) | jnp.any(singular[count:] > _ZERO)
    words = (
        f"{owner}: constraints repeat each other otherwise than was known while JAX traced, so "
        "that there are more or fewer freedoms; take out those that repeat others, or call it "
        "without a transformation of what the mechanism is made of."
    )
    return count - lengths, eqx.error_if(q, others, words)


def _independent_at_start(system: AbstractSystem, t: Float[Array, ""]) -> int | None:
    """How many constraints, lengths of quaternions among them, do not repeat others at the start;
    None where that is traced.
    """
    if any(is_traced(x) for x in jax.tree.leaves((system, t))):
        return None
    q = system.q0
    values, _ = outside_of_traces(lambda: _constraints(system, t, q, jnp.zeros_like(q)))
    return int(np.sum(np.asarray(values) > _ZERO))


@program_once
def _constraints(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, " least"], Start]:
    """The singular values of the constraints, and what they are at a state."""
    values = jnp.linalg.svd(scaled_rows(system, t, q)[0], compute_uv=False)
    return values, Start.of(system, t, q, v, _CONTRADICTS)


def _check_state(owner: str, system: AbstractSystem, state: Start, rates: bool) -> None:
    """Raise InputError, beginning with `owner`, for a state that the constraints contradict; by its
    velocity, too, where `rates` count.
    """
    names = system.structure.constraints
    # A batch over velocities at one configuration is known in part.
    closed, fits = concrete(state.closed), concrete(state.fits)
    if closed is not None and not closed:
        row = state.worst()
        raise InputError(
            f"{owner}: {names[row]} is violated by {float(state.violation[row]):.3g} in the state "
            "that is asked about; take an equilibrium, romjax.equilibrium(system, t=t), or a state "
            "of romjax.consistent(system, q, v, t).",
            part=names[row],
        )
    if rates and fits is not None and not fits:
        fastest = state.worst_rate()
        raise InputError(
            f"{owner}: {names[fastest]} is violated at the rate {float(state.rate[fastest]):.3g} "
            "/s by the velocity that is asked about; leave v out for a mechanism at rest whose "
            "drives stand, or take one of romjax.consistent(system, q, v, t).",
            part=names[fastest],
        )


def check_turn(
    owner: str, system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Array
) -> None:
    """Raise InputError, beginning with `owner`, where a drive moves at a rate that a mechanism that
    turns with the velocities `v` does not have: then it does not turn steadily.
    """
    if system.m == 0 or not moves(system):
        return
    (_, still), (_, turned) = (_constraints(system, t, q, x) for x in (jnp.zeros_like(v), v))
    rates, left, allowed = (concrete(x) for x in (still.rate, turned.rate, turned.allowed_rate))
    if rates is None or left is None or allowed is None:
        return
    # The ground turns too, so that joints to it are asked for nothing unless they move by
    # themselves.
    wrong = np.flatnonzero((np.abs(rates) > allowed) & (np.abs(left) > allowed))
    if wrong.size:
        name, row = system.structure.constraints[wrong[0]], wrong[0]
        raise InputError(
            f"{owner}: {name} moves by {float(-rates[row]):.3g} /s and turning makes it move by "
            f"{float(left[row] - rates[row]):.3g}, so that the mechanism does not turn steadily; "
            "give turning the angular velocity of the drive, or v, the velocities of one moment.",
            part=name,
        )


def scaled_rows(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> tuple[Float[Array, "m n"], Float[Array, "n n"]]:
    """C_q L⁻ᵀ, those of lengths of quaternions among its rows of unit length, and L of M = L Lᵀ; a
    row of zeros without constraints.
    """
    half = jnp.linalg.cholesky(system.mass(q))
    if unit_length.count(system) == 0:
        return jnp.zeros((1, system.n), q.dtype), half
    rows = unit_length.jacobian(system, t, q)
    free = jax.scipy.linalg.solve_triangular(half, rows.T, lower=True).T
    lengths = jnp.sqrt(jnp.sum(free**2, axis=1, keepdims=True))
    return free / jnp.where(lengths > 0, lengths, 1), half
