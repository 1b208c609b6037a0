"""Mechanisms whose drives stand still, as statics and motions about rest ask for them."""

from typing import Any, TypeVar, cast

import jax
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..scene.joint.base import AbstractJoint
from ..scene.signal import AbstractSignal, is_signal, signals_of
from ..system.base import AbstractSystem

S = TypeVar("S", bound=AbstractSystem)


class _Standing(AbstractSignal):
    """A signal with the values of another one at any time, and rates of zero."""

    signal: AbstractSignal

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.signal(jax.lax.stop_gradient(t))


def standing(system: S) -> S:
    """The full or reduced system whose drives stand where they are at any time t.

    C(t, q) stays and C_t = C_tt = 0, so that v = 0 is rest in coordinates in which the drives are
    already solved for, too: these would move the bodies at v = 0, and with their accelerations.
    """
    parts = jax.tree.leaves(system, is_leaf=_is_joint)
    if not any(signals_of(part) for part in parts if _is_joint(part)):
        return system
    return cast(S, jax.tree.map(_stopped, system, is_leaf=_is_joint))


def _is_joint(x: Any) -> bool:
    return isinstance(x, AbstractJoint)


def _stopped(part: Any) -> Any:
    if not _is_joint(part):
        return part
    return jax.tree.map(lambda x: _Standing(x) if is_signal(x) else x, part, is_leaf=is_signal)
