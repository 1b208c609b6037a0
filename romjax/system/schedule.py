"""Times at which the loads of a system change, so that the steps of a run see it."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common import compat
from ..common.arrays import Time
from ..scene.signal import AbstractSignal, is_signal, signals_of
from .base import AbstractSystem

# Loads that do not say when they change are evaluated so many times between two outputs.
_LOOKS = 16
# The number of output intervals that are evaluated as one array.
_AT_ONCE = 64
# A load changes too fast for a step between two outputs if a polynomial through every fourth of
# these values misses the others by more than this share of all that it changes.
_SEEN = 1e-4


class AbstractStack(eqx.Module):
    """Elements of one `kind`; all their arrays have one leading axis."""

    @property
    @abc.abstractmethod
    def kind(self) -> type: ...


class _Still(AbstractSignal):
    """A signal that keeps the value that another one has at t = 0."""

    signal: AbstractSignal

    def __call__(self, t: Time) -> Float[Array, ""]:
        return self.signal(jnp.zeros_like(t))


def _has_numbers(signal: AbstractSignal) -> bool:
    return any(eqx.is_array(x) for x in jax.tree.leaves(signal))


class Schedule(eqx.Module):
    """The signals of a system.

    - `stacked`: those of an `AbstractStack`, with its leading axis. `single`: all others.
    - `changing`: the full system, where something else changes with time.
    - `outputs`, `hidden`: where something says nothing of when it changes, the times of outputs,
      and whether it does so in the time up to the next one too fast for a step of that length.
    """

    stacked: tuple[AbstractSignal, ...]
    single: tuple[AbstractSignal, ...]
    changing: AbstractSystem | None
    outputs: Float[Array, " outputs"] | None = None
    hidden: Bool[Array, " parts"] | None = None

    @classmethod
    def of(cls, system: AbstractSystem) -> "Schedule":
        """The signals of a full or a reduced system."""
        full = system.full
        parts = jax.tree.leaves(
            full, is_leaf=lambda x: isinstance(x, AbstractStack) or is_signal(x)
        )
        stacks = [part for part in parts if isinstance(part, AbstractStack)]
        signals = [signal for stack in stacks for signal in signals_of(stack)]
        # Those without numbers, as users' own may be, have no axis: they are one for all elements.
        stacked = [signal for signal in signals if _has_numbers(signal)]
        single = [signal for signal in signals if not _has_numbers(signal)]
        single += [part for part in parts if is_signal(part)]
        # Elements of romjax change with time by their signals only. Others are traced to find out,
        # which takes a while.
        own = stacks and all(stack.kind.__module__.startswith("romjax.") for stack in stacks)
        changing = None if own or not _changes(full) else full
        return cls(tuple(stacked), tuple(single), changing)

    @property
    def is_known(self) -> bool:
        """Whether the signals say when they change, and nothing else changes with time."""
        known = all(signal.is_known for signal in self.stacked + self.single)
        return known and self.changing is None

    def corners(self, ts: Float[Array, " outputs"]) -> Float[Array, " k"]:
        """Return the times [s] at which steps of a run have to end; infinite ones are none.

        `ts`: the times of the outputs.
        """
        stacked = [jax.vmap(lambda x: x.corners())(signal) for signal in self.stacked]
        times = [x.reshape(-1) for x in stacked] + [x.corners() for x in self.single]
        known = [x.astype(ts.dtype) for x in times if x.size]
        # Where nobody tells when loads change, steps end at the outputs: what was looked at between
        # two of them holds for one step.
        return jnp.concatenate([ts[:0] if self.is_known else ts, *known])

    def seeing(self, ts: Float[Array, " outputs"]) -> "Schedule":
        """Return the schedule with the changes that are found between the outputs of a run.

        Nothing is searched for if all loads say when they change.
        """
        if self.is_known:
            return self
        shares = np.arange(_LOOKS + 1) / _LOOKS
        # The matrix of Lagrange's interpolation through every fourth value. Five of the seventeen
        # values make a polynomial of degree four.
        told = np.linalg.solve(np.vander(shares[::4]).T, np.vander(shares, 5).T).T

        def part(ends: tuple[Array, Array]) -> tuple[Array, ...]:
            """Least and largest values between two outputs, and by how much they are not told."""
            begin, end = ends
            values = jax.vmap(self._unknown)(begin + (end - begin) * jnp.asarray(shares, ts.dtype))
            missed = jnp.abs(values - jnp.asarray(told, ts.dtype) @ values[::4])
            return values.min(axis=0), values.max(axis=0), missed.max(axis=0)

        least, largest, missed = jax.lax.map(part, (ts[:-1], ts[1:]), batch_size=_AT_ONCE)
        least, largest = least.min(axis=0), largest.max(axis=0)
        # Rounding, which is all that a constant load changes by, is no change.
        rounding = 100 * jnp.finfo(ts.dtype).eps * jnp.maximum(jnp.abs(least), jnp.abs(largest))
        short = jnp.any(missed > (_SEEN * (largest - least) + rounding)[None], axis=1)
        # Both neighbours of such an interval take short steps too: the change may reach into them.
        hidden = short.at[1:].max(short[:-1]).at[:-1].max(short[1:])
        return Schedule(self.stacked, self.single, self.changing, ts, hidden)

    def _unknown(self, t: Float[Array, ""]) -> Float[Array, " c"]:
        """Evaluate what does not say when it changes: signals, or forces and constraints."""
        stacked = [jax.vmap(lambda x: x(t))(one) for one in self.stacked if not one.is_known]
        values = stacked + [one(t) for one in self.single if not one.is_known]
        if (full := self.changing) is not None:
            values += [full.force(t, full.q0, full.v0), full.constraint(t, full.q0)]
        return jnp.concatenate([x.astype(t.dtype).reshape(-1) for x in values])

    @property
    def limits_steps(self) -> bool:
        """Whether there is a longest step."""
        return self.hidden is not None or any(
            type(signal).longest_step is not AbstractSignal.longest_step
            for signal in self.stacked + self.single
        )

    def longest_step(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """The longest step from a time t that still sees all signals [s]."""
        stacked = [jax.vmap(lambda x: x.longest_step(t))(signal) for signal in self.stacked]
        each = [x.reshape(-1) for x in stacked] + [x.longest_step(t)[None] for x in self.single]
        longest = jnp.min(jnp.concatenate([t[None][:0], *each]), initial=jnp.inf)
        if self.outputs is None or self.hidden is None:
            return longest
        part = jnp.searchsorted(self.outputs, t, side="right") - 1
        part = jnp.clip(part, 0, len(self.hidden) - 1)
        look = (self.outputs[part + 1] - self.outputs[part]) / _LOOKS
        return jnp.where(self.hidden[part], jnp.minimum(longest, look), longest)


def _changes(full: AbstractSystem) -> bool:
    """Whether anything but signals changes with time."""
    still = jax.tree.map(lambda x: _Still(x) if is_signal(x) else x, full, is_leaf=is_signal)

    def at(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        return still.force(t, q, v), still.constraint(t, q)

    return compat.depends_on_first(at, jnp.zeros((), full.q0.dtype), full.q0, full.v0)
