"""When the loads of a system change, so that the steps of a run see it."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time
from ..scene.signal import AbstractSignal
from .base import AbstractSystem


class Stack(eqx.Module):
    """Elements of one `kind`; all their arrays have one leading axis."""

    @property
    @abc.abstractmethod
    def kind(self) -> type: ...


class _Still(AbstractSignal):
    """What a signal is at the start of time, for ever."""

    signal: AbstractSignal

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.signal(jnp.zeros_like(t))


class Schedule(eqx.Module):
    """The signals of a system.

    - `stacked`: those of a `Stack`, with its leading axis. `single`: all others.
    - `is_known`: whether they say when they change, and nothing else changes with time.
    """

    stacked: tuple[AbstractSignal, ...]
    single: tuple[AbstractSignal, ...]
    is_known: bool = eqx.field(static=True)

    @classmethod
    def of(cls, system: AbstractSystem) -> "Schedule":
        """The signals of a full or a reduced system."""
        full = system.full
        parts = jax.tree.leaves(full, is_leaf=lambda x: isinstance(x, Stack) or _is_signal(x))
        stacks = [part for part in parts if isinstance(part, Stack)]
        stacked = [signal for stack in stacks for signal in _signals(stack)]
        single = [part for part in parts if _is_signal(part)]
        known = all(signal.is_known for signal in stacked + single)
        # Elements of romjax change with time by their signals only; tracing others takes a while.
        own = stacks and all(stack.kind.__module__.startswith("romjax.") for stack in stacks)
        return cls(tuple(stacked), tuple(single), known and (bool(own) or not _changes(full)))

    def corners(self, ts: Float[Array, " outputs"]) -> Float[Array, " k"]:
        """When the steps of a run with outputs at `ts` have to end [s]; infinite times are none."""
        stacked = [jax.vmap(lambda x: x.corners())(signal) for signal in self.stacked]
        times = [x.reshape(-1) for x in stacked] + [x.corners() for x in self.single]
        known = [x.astype(ts.dtype) for x in times if x.size]
        return jnp.concatenate([ts[:0] if self.is_known else ts, *known])

    @property
    def limits_steps(self) -> bool:
        """Whether there is a longest step."""
        return any(
            type(signal).longest_step is not AbstractSignal.longest_step
            for signal in self.stacked + self.single
        )

    def longest_step(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """The longest step from a time t that still sees all signals [s]."""
        stacked = [jax.vmap(lambda x: x.longest_step(t))(signal) for signal in self.stacked]
        each = [x.reshape(-1) for x in stacked] + [x.longest_step(t)[None] for x in self.single]
        return jnp.min(jnp.concatenate(each), initial=jnp.inf)


def _is_signal(x: Any) -> bool:
    return isinstance(x, AbstractSignal)


def _signals(tree: Any) -> list[AbstractSignal]:
    return [x for x in jax.tree.leaves(tree, is_leaf=_is_signal) if _is_signal(x)]


def _changes(full: AbstractSystem) -> bool:
    """Whether anything but signals changes with time."""
    still = jax.tree.map(lambda x: _Still(x) if _is_signal(x) else x, full, is_leaf=_is_signal)

    def at(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        return still.force(t, q, v), still.constraint(t, q)

    return compat.depends_on_first(at, jnp.zeros((), full.q0.dtype), full.q0, full.v0)
