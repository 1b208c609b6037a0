"""Whether a mechanism can move at all, and what signals move of it."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time, concrete
from ..common.errors import InputError
from ..compiling.program import program_once
from ..scene.signal import AbstractSignal, is_signal
from . import unit_length
from .base import AbstractSystem
from .dynamics import jacobian
from .schedule import AbstractStack
from .structure import without_names


def check_mobility(
    owner: str,
    system: AbstractSystem,
    remedy: str = "",
    error: type[InputError] = InputError,
) -> None:
    """Raise an error if more constraints than freedoms leave no motion at the start.

    Lengths of quaternions are no freedoms. Repeated constraints do not count: a mechanism may have
    them, and the solution of its equations of motion stays unique. Constraints that change with
    time move what has no freedom left, at rates that all constraints allow.
    """
    structure = system.structure
    freedoms = system.n - len(structure.quaternions) - len(structure.states)
    # Counting is enough for most mechanisms; only where constraints outnumber freedoms is their
    # rank computed, since redundant ones may still leave a motion.
    if system.m <= freedoms:
        return
    rows, driven = (concrete(x) for x in _at_start(without_names(system)))
    if rows is None or driven is None or np.linalg.matrix_rank(rows) < freedoms:
        return
    # Constraints of full rank leave a motion only if they move with time and C_q q̇ = −C_t has a
    # solution.
    locked = np.linalg.matrix_rank(np.column_stack([rows, driven])) > freedoms
    if locked or not moves(system):
        words = f"{system.m} constraints on {system.n} coordinates leave no motion. {remedy}"
        raise error(f"{owner}: {words}".rstrip())


def moves(system: AbstractSystem) -> bool:
    """Whether constraints of a system change with time, as those of drives do."""
    return compat.depends_on_first(system.constraint, jnp.zeros((), system.q0.dtype), system.q0)


@program_once
def _at_start(system: AbstractSystem) -> tuple[Float[Array, "m n"], Float[Array, " m"]]:
    """The constraint Jacobian at the start, and the rates of the constraints at rest."""
    time = jnp.zeros((), system.q0.dtype)
    _, driven = jax.jvp(lambda t: system.constraint(t, system.q0), (time,), (jnp.ones_like(time),))
    return jacobian(system, time, system.q0), driven


class _Shifted(AbstractSignal):
    """A signal with a number added to it."""

    signal: AbstractSignal
    shift: Float[Array, ""]

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.signal(t) + self.shift


def slopes_by_signals(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, "m k"]:
    """The derivatives of the constraints, lengths of quaternions included, by the values of all
    signals that change, which tell what a drive moves however late it begins.
    """
    total = _shifted(system, None)[1]

    def constraint(shifts: Array) -> Array:
        return unit_length.extended(_shifted(system, shifts)[0], t, q)

    slopes: Array = jax.jacfwd(constraint)(jnp.zeros(total, q.dtype))
    return slopes


def _shifted(
    system: AbstractSystem, shifts: Float[Array, " k"] | None
) -> tuple[AbstractSystem, int]:
    """The system with numbers added to its signals, and how many they are."""
    total = 0

    def one(part: Any, shape: tuple[int, ...] = ()) -> Any:
        nonlocal total
        if not is_signal(part) or part.is_constant:
            return part
        count = math.prod(shape)
        begin, total = total, total + count
        if shifts is None:
            return part
        return _Shifted(part, shifts[begin : begin + count].reshape(shape))

    def several(part: Any) -> Any:
        if not isinstance(part, AbstractStack):
            return one(part)
        # All arrays of a stack have one leading axis, along which it is mapped.
        shape = jnp.shape(jax.tree.leaves(part)[0])[:1]
        return jax.tree.map(lambda x: one(x, shape), part, is_leaf=is_signal)

    made = jax.tree.map(
        several, system, is_leaf=lambda x: isinstance(x, AbstractStack) or is_signal(x)
    )
    return made, total
