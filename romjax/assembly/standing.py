"""Mechanisms whose drives stand still, as statics and motions about rest ask for them."""

from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..compiling.program import program_once
from ..scene.signal import AbstractSignal, Constant, is_signal, signals_of
from ..system.base import AbstractSystem
from .groups import JointGroup

S = TypeVar("S", bound=AbstractSystem)


def standing(system: S, t: ArrayLike) -> S:
    """The full or reduced system whose drives stand where they are at a time t [s].

    C(t, q) stays and C_t = C_tt = 0, so that v = 0 is rest in coordinates in which the drives are
    already solved for, too: these would move the bodies at v = 0, and with their accelerations.
    Derivatives by t are those of where the drives stand.
    """
    groups = [x for x in jax.tree.leaves(system, is_leaf=_is_group) if _is_group(x)]
    signals = tuple(signal for group in groups for signal in signals_of(group))
    if not signals:
        return system
    each = tuple(np.zeros(g.markers.count) for g in groups for _ in signals_of(g))
    values = iter(_values(signals, each, jnp.asarray(t, system.q0.dtype)))

    def stopped(part: Any) -> Any:
        if not _is_group(part):
            return part
        return jax.tree.map(
            lambda x: Constant(next(values)) if is_signal(x) else x, part, is_leaf=is_signal
        )

    return cast(S, jax.tree.map(stopped, system, is_leaf=_is_group))


@program_once
def _values(
    signals: tuple[AbstractSignal, ...],
    each: tuple[Float[Array | np.ndarray, " count"], ...],
    t: Float[Array | np.ndarray, ""],
) -> list[Float[Array, " count"]]:
    """What signals that are stacked have at a time, each of as many joints as `each` has."""
    return [
        # A signal may have no numbers of its own.
        jax.vmap(lambda one, _: jnp.asarray(one(jnp.asarray(t))))(signal, jnp.asarray(count))
        for signal, count in zip(signals, each, strict=True)
    ]


def _is_group(x: Any) -> bool:
    return isinstance(x, JointGroup)
