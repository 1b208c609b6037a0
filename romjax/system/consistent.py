"""A start that satisfies the constraints."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import precision
from ..arrays import Vector, as_array, concrete
from ..checks import check_shape
from ..errors import InputError
from ..program import program_once
from .base import AbstractSystem, check_system
from .dynamics import constraint_state

START_SWEEPS = 10


def consistent(
    system: AbstractSystem,
    q0: Vector | None = None,
    v0: Vector | None = None,
    t: ArrayLike = 0.0,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The nearest start that satisfies C = 0 and Ċ = 0, positions first, then velocities.

    Nearest in the mass metric, which no choice of units changes: Gauss–Newton for the positions,
    one projection for the velocities.

    **Arguments:** the `system`; start `q0`, `v0` (n,), its own unless given; time `t` [s].

    Raises InputError, naming the constraint and what is left of it, if ten sweeps do not get
    |C| below 1e-10, or if no velocity gets |Ċ| below 1e-8: joints that move contradict each other.
    """
    check_system("consistent", system)
    q, v = check_start_shapes(system, q0, v0)
    time = jnp.asarray(t, q.dtype)
    if system.m == 0:
        return q, v
    q, v, *left = _project_start(system, q, v, time)
    violation, rate = (concrete(x) for x in left)
    if violation is None or rate is None:
        return q, v
    worst = int(np.argmax(np.abs(violation)))
    if not abs(violation[worst]) <= _scale(q) * precision.of(q.dtype).projected:
        raise InputError(
            f"consistent: after {START_SWEEPS} sweeps {system.structure.constraints[worst]} is "
            f"still violated by {violation[worst]:.3g}; the joints cannot all hold, or the given "
            "start is too far from any configuration where they do."
        )
    worst = int(np.argmax(np.abs(rate)))
    if not abs(rate[worst]) <= _scale(v) * precision.of(q.dtype).start_tolerance:
        raise InputError(
            f"consistent: {system.structure.constraints[worst]} is still violated by a rate of "
            f"{rate[worst]:.3g} /s; no velocity suits all joints: motions that are prescribed "
            "contradict each other, or a joint that stands still."
        )
    return q, v


def _scale(x: Array) -> float:
    return max(1.0, float(jnp.max(jnp.abs(x))))


def project(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    sweeps: int,
    solves: int = 1,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The nearest state on C = 0 and Ċ = 0 in the mass metric: Gauss–Newton, then linear solves."""

    def sweep(q: Array, _: Any) -> tuple[Array, None]:
        kkt = system.state(t, q, v).kkt()
        step, _ = kkt.solve(jnp.zeros_like(q), -system.constraint(t, q))
        return q + step, None

    def solve(v: Array, _: Any) -> tuple[Array, None]:
        # Subtracting the part that violates Ċ = 0, not solving for what remains of M v: a velocity
        # that is already right keeps its last digit.
        excess = constraint_state(system, t, q, v).rate
        step, _ = system.state(t, q, v).kkt().solve(jnp.zeros_like(v), -excess)
        return v + step, None

    q, _ = jax.lax.scan(sweep, q, None, length=sweeps)
    v, _ = jax.lax.scan(solve, v, None, length=solves, unroll=solves == 1)
    return q, v


def project_start(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """A projection from any distance, of velocities too."""
    # The first solve leaves 1e-12 of what a far velocity violates, the second nothing.
    return project(system, t, q, v, START_SWEEPS, solves=2)


@program_once
def _project_start(
    system: AbstractSystem, q: Float[Array, " n"], v: Float[Array, " n"], t: Float[Array, ""]
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " m"], Float[Array, " m"]]:
    q, v = project_start(system, t, q, v)
    state = constraint_state(system, t, q, v)
    return q, v, state.violation, state.rate


def check_start_shapes(
    system: AbstractSystem, q0: Vector | None, v0: Vector | None
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The start, that of the system unless given; raise InputError on a wrong shape."""
    q = system.q0 if q0 is None else as_array(q0)
    v = system.v0 if v0 is None else as_array(v0)
    n = system.n
    check_shape("start", "q0", q, (n,))
    check_shape("start", "v0", v, (n,))
    return q, v
