"""Steady turns of a whole mechanism about the origin."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..common.arrays import Time, as_array
from ..common.checks import check_shape
from ..common.errors import InputError
from ..compiling.program import program_once
from ..linalg import quaternions
from ..system import dynamics
from ..system.base import AbstractSystem
from ..system.structure import without_names


def turn(
    owner: str, system: AbstractSystem, turning: ArrayLike, t: Time, q: Float[Array, " n"]
) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    """The generator J of a turn with the angular velocity `turning` Ω [rad/s], by which rates as
    seen from a frame that turns with it are less by J δq, and the velocity of the mechanism.

    In the plane positions have the rates Ω (−y, x) and angles Ω. In space, Ω a vector or a number
    about z, ẋ = Ω × x and ṗ = ½ (0, Ω) ⊗ p, which is linear, and counters follow what they count.

    Raises InputError, beginning with `owner`, for a system without bodies or a wrong shape.
    """
    structure = system.structure
    if not structure.frames:
        raise InputError(
            f"{owner}: turning needs a system of bodies, but the coordinates are "
            f"{', '.join(structure.labels[:4])}; give v instead."
        )
    omega = jnp.asarray(as_array(turning), q.dtype)
    shape = (3,) if structure.quaternions and omega.ndim else ()
    check_shape(owner, "turning", omega, shape)
    result: tuple[Array, Array] = _turn(without_names(system), omega, jnp.asarray(t, q.dtype), q)
    return result


@program_once
def _turn(
    system: AbstractSystem,
    omega: Float[Array, "*axes"],
    t: Float[Array, ""],
    q: Float[Array, " n"],
) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    structure, rows = system.structure, jnp.zeros((system.n, system.n), q.dtype)
    if not structure.quaternions:
        x, y = structure.positions.T
        rows = rows.at[x, y].set(-omega).at[y, x].set(omega)
        return rows, (rows @ q).at[structure.turns].set(omega)
    axes = omega * np.array([0, 0, 1], q.dtype) if omega.ndim == 0 else omega
    blocks = (structure.positions, quaternions.skew(axes)), (structure.turns, _left(axes))
    for columns, block in blocks:
        rows = rows.at[columns[:, :, None], columns[:, None]].set(block[None])
    return rows, _counted(system, t, q, rows @ q)


def _left(omega: Float[Array, "3"]) -> Float[Array, "4 4"]:
    """½ (0, Ω) ⊗ as a matrix."""
    given = 0.5 * quaternions.from_vector(omega)
    columns = quaternions.product(given[None], jnp.eye(4, dtype=omega.dtype))
    return columns.T


def _counted(
    system: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Return `v` with the rates of counters filled in; each counter is in one constraint only."""
    counters = np.array(system.structure.counters, int)
    if not counters.size:
        return v
    rows = dynamics.jacobian(system, t, q)
    own = rows[:, counters]
    # Its row is zero where its rate makes up for all others in it.
    rates = -(own.T @ (rows @ v)) / jnp.sum(own**2, axis=0)
    return v.at[counters].set(rates)
