"""Evaluation at each output of a run: of accelerations, and of any other function."""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from ..assembly.locate import assembled
from ..assembly.standing import standing
from ..common import compat
from ..common.arrays import Vector, as_array
from ..common.checks import as_time, check_finite, check_shape
from ..common.errors import InputError
from ..compiling.program import program
from ..integrate.origin import check_origin
from ..integrate.outputs import capacity, cut, padded
from ..integrate.reactions import balancing_multipliers, lifted_acceleration
from ..integrate.trajectory import Trajectory
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.reduced import reduced_of
from ..system.structure import without_names


def along(at: Callable[..., Any], fixed: Any, *states: Float[Array, "k ..."]) -> Any:
    """`at(fixed, *state)` at each row of the `states`, stacked.

    `at` is a function of a module, `fixed` a pytree. By a program of its own, which is the same for
    any number of rows, or as a part of the user's where JAX traces.
    """
    if not compat.is_outermost():
        return jax.lax.map(lambda state: at(fixed, *state), states)
    count, dtype = len(states[0]), states[0].dtype
    size = capacity(count, sum(int(np.prod(x.shape[1:])) for x in states), dtype)
    rows = tuple(padded(x, size) for x in states)
    return cut(_looped(at, fixed, rows, np.asarray(count)), count)


@program
def _looped(
    at: Callable[..., Any], fixed: Any, states: Any, count: Int[Array | np.ndarray, ""]
) -> Any:
    """The first `count` rows of `along`, and zeros."""

    def row(i: Any) -> Any:
        return at(fixed, *(jnp.asarray(x)[i] for x in states))

    def put(i: Array, rows: Any) -> Any:
        return jax.tree.map(
            lambda x, new: jax.lax.dynamic_update_index_in_dim(x, new, i, 0), rows, row(i)
        )

    size = len(states[0])
    empty = jax.tree.map(lambda x: jnp.zeros((size, *x.shape), x.dtype), jax.eval_shape(row, 0))
    return jax.lax.fori_loop(0, jnp.asarray(count), put, empty)


class Rest(NamedTuple):
    """A mechanism at rest in the physical coordinates q (n,), in the place of a run."""

    t: Float[Array, ""]
    q: Float[Array, " n"]
    v: Float[Array, " n"]


def along_run(
    run: Trajectory | Rest, at: Callable[..., Any], fixed: Any, *states: Float[Array, "..."]
) -> Any:
    """`along` the outputs of a run; at rest, the value there."""
    if run.t.ndim:
        return along(at, fixed, *states)
    return jax.tree.map(lambda x: x[0], along(at, fixed, *(x[None] for x in states)))


def run_or_rest(
    owner: str, system: AbstractSystem, run: Trajectory | Vector, t: ArrayLike | None
) -> tuple[AbstractSystem, Trajectory | Rest]:
    """The system and its `run`, or the `standing` system and its rest in coordinates (n,) at time
    `t` [s], zero for None; raises InputError as `check_run`, for another shape, for a number that
    is not finite, and for a run with a time of rest.
    """
    if not isinstance(run, jax.Array | np.ndarray | list | tuple):
        moved = cast(Trajectory, run)
        check_run(owner, system, moved)
        if t is not None:
            raise InputError(
                f"{owner}: t is the time of a mechanism at rest, but a run has its own times; "
                "leave it out, or give coordinates (n,) in place of the run."
            )
        return system, moved
    _check_mechanism(owner, system)
    try:
        q = as_array(run)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{owner}: the run is of type {type(run).__name__}, and not of numbers; give one run, "
            "or coordinates (n,) of a position at rest."
        ) from error
    check_shape(owner, "q", q, (system.n,))
    check_finite(owner, "q", q)
    time = as_time(owner, 0.0 if t is None else t, q.dtype)
    still = standing(system, time)
    return still, Rest(*_at_rest(without_names(still), time, q))


@program
def _at_rest(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " r"]
) -> tuple[Float[Array, ""], Float[Array, " n"], Float[Array, " n"]]:
    # States of effects have places in q, and act by those in v.
    state = system.state(t, q, system.structure.at_rest(q))
    return t, state.q, state.v


def check_run(owner: str, system: AbstractSystem, run: Trajectory) -> None:
    """Raise InputError, beginning with `owner`, unless `run` is one of a mechanism of bodies, and
    of this `system`.
    """
    check_origin(owner, _check_mechanism(owner, system), run)


def _check_mechanism(owner: str, system: AbstractSystem) -> AbstractSystem:
    """The full system; raises InputError unless it is one of bodies, whose equations `system`
    follows.
    """
    full = assembled(owner, system)
    rom = reduced_of(system)
    if rom is not None and not rom.satisfies_dynamics:
        raise InputError(
            f"{owner}: a {type(system).__name__} follows no equations of motion of the mechanism; "
            "reduce by rj.Galerkin() or rj.Minimal(), or give the full system."
        )
    return full


def accelerations(system: AbstractSystem, run: Trajectory | Rest) -> Float[Array, "*k n"]:
    """Accelerations of the physical coordinates along a `run` of a full or reduced `system`, by its
    equations of motion without stabilisation.
    """
    rows: Float[Array, "*k n"] = along_run(run, _acceleration, system, run.t, run.q, run.v)
    return rows


def solved(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    """Acceleration and multipliers of the mechanism at a physical state of a full or reduced
    `system`, without stabilisation.
    """
    rom = reduced_of(system)
    if rom is None or rom.is_exact:
        a, multipliers, _ = solve(system.full, t, q, v, None)
        return a, multipliers
    a = lifted_acceleration(rom, t, q, v)
    return a, balancing_multipliers(rom, t, q, v, a)


def _acceleration(system: Any, t: Array, q: Array, v: Array) -> Array:
    # XLA leaves out what belongs to the multipliers of reduced systems.
    return solved(system, t, q, v)[0]
