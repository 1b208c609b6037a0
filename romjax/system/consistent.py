"""A start that satisfies the constraints."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..common import precision
from ..common.arrays import Vector, as_array, concrete
from ..common.checks import as_time, check_shape
from ..common.errors import InputError
from ..compiling.program import program_once
from ..linalg.kkt import KKT
from .base import AbstractSystem, check_system
from .dynamics import constraint_state
from .start import Start

# A start that is guessed gets to the constraints in fewer, quadratically, or not at all.
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
    |C| below 1e-10, or if no velocity gets |Ċ| below 1e-8, of the mechanism's size as in
    `romjax/system/start.py`: joints that move contradict each other.
    """
    check_system("consistent", system)
    q, v = check_start_shapes(system, q0, v0)
    time = as_time("consistent", t, q.dtype)
    if system.m == 0:
        return q, v
    q, v, start = _project_start(system, q, v, time)
    if concrete(start.violation) is not None:
        check_closed("consistent", system, start)
        check_rates("consistent", system, start)
    return q, v


def check_closed(owner: str, system: AbstractSystem, start: Start) -> None:
    """Raise InputError, beginning with `owner`, if a constraint is violated after all sweeps."""
    worst = start.worst()
    if not start.closed:
        part = system.structure.constraints[worst]
        raise InputError(
            f"{owner}: after {START_SWEEPS} sweeps {part} is still violated by "
            f"{start.violation[worst]:.3g}; the joints cannot all hold, or the given start is too "
            "far from any configuration where they do.",
            part=part,
        )


def check_rates(owner: str, system: AbstractSystem, start: Start) -> None:
    """Raise InputError, beginning with `owner`, if no velocity was found that suits all joints."""
    worst = start.worst_rate()
    if not start.fits:
        part = system.structure.constraints[worst]
        raise InputError(
            f"{owner}: {part} is still violated by a rate of {start.rate[worst]:.3g} /s; no "
            "velocity suits all joints: motions that are prescribed contradict each other, or a "
            "joint that stands still.",
            part=part,
        )


def project(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    sweeps: int,
    solves: int = 1,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The nearest state on C = 0 and Ċ = 0 in the mass metric: Gauss–Newton, then linear solves."""

    def kkt(q: Array) -> KKT:
        return system.state(t, q, v).kkt()

    q = closed(system, t, q, kkt, sweeps)
    return q, fitting(system, t, q, v, kkt, solves)


def closed(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    kkt: Callable[[Array], KKT],
    sweeps: int,
) -> Float[Array, " n"]:
    """Coordinates after sweeps towards C = 0, by steps that the extended mass matrix decides."""

    def sweep(q: Array, _: Any) -> tuple[Array, None]:
        # The least step in the mass metric with C_q Δq = −C: Gauss–Newton.
        step, _ = kkt(q).solve(jnp.zeros_like(q), -system.constraint(t, q))
        return q + step, None

    position: Array
    position, _ = jax.lax.scan(sweep, q, None, length=sweeps)
    return position


def fitting(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    kkt: Callable[[Array], KKT],
    solves: int,
) -> Float[Array, " n"]:
    """Velocities with Ċ = 0, by changes that the extended mass matrix decides."""

    def solve(v: Array, _: Any) -> tuple[Array, None]:
        # Subtracting the part that violates Ċ = 0, not solving for what remains of M v: a velocity
        # that is already right keeps its last digit.
        excess = constraint_state(system, t, q, v).rate
        step, _ = kkt(q).solve(jnp.zeros_like(v), -excess)
        return v + step, None

    velocity: Array
    velocity, _ = jax.lax.scan(solve, v, None, length=solves, unroll=solves == 1)
    return velocity


def project_start(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """A projection from any distance, of velocities too."""
    # The first solve leaves 1e-12 of what a far velocity violates, the second nothing.
    return project(system, t, q, v, START_SWEEPS, solves=2)


@program_once
def _project_start(
    system: AbstractSystem, q: Float[Array, " n"], v: Float[Array, " n"], t: Float[Array, ""]
) -> tuple[Float[Array, " n"], Float[Array, " n"], Start]:
    q, v = project_start(system, t, q, v)
    limits = precision.of(q.dtype)
    return q, v, Start.of(system, t, q, v, limits.projected, limits.start_tolerance)


def check_start_shapes(
    system: AbstractSystem, q0: Vector | None, v0: Vector | None
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The start, that of the system unless given; raise InputError on a wrong shape."""
    q = system.q0 if q0 is None else as_array(q0)
    v = system.v0 if v0 is None else as_array(v0)
    n, structure = system.n, system.structure
    check_shape("start", "q0", q, (n,))
    check_shape("start", "v0", v, (n,))
    if structure.states and q0 is not None and v0 is None:
        # A configuration has states in their places, as `equilibrium` returns them.
        v = structure.without_states(v) + structure.at_rest(q)
    return q, v
