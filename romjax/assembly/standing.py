"""Mechanisms whose drives stand still, as statics and motions about rest ask for them."""

from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from ..system.base import AbstractSystem
from ..system.mobility import moves
from ..system.standing import AbstractConstrained

S = TypeVar("S", bound=AbstractSystem)


def standing(system: S, t: ArrayLike) -> S:
    """The full or reduced system whose drives stand where they are at a time t [s].

    C(t, q) stays and C_t = C_tt = 0, so that v = 0 is rest in coordinates in which the drives are
    already solved for, too: these would move the bodies at v = 0, and with their accelerations.
    Derivatives by t are those of where the drives stand.
    """
    if not moves(system.full):
        return system
    time = jnp.asarray(t, system.q0.dtype)

    def stopped(part: Any) -> Any:
        return part.standing_at(time) if _is_constrained(part) else part

    return cast(S, jax.tree.map(stopped, system, is_leaf=_is_constrained))


def _is_constrained(part: Any) -> bool:
    return isinstance(part, AbstractConstrained)
