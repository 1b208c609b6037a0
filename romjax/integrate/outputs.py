"""Rows that are saved at the output times, and room for them."""

import functools
import itertools
import operator
from collections.abc import Iterator
from typing import Any, NamedTuple, SupportsIndex

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.compat import is_traced
from ..common.errors import InputError
from ..common.identity_cache import IdentityCache
from ..system.base import AbstractSystem
from ..system.local import local_system
from .post_step import PostStep

# Fewer outputs than fill so many bytes share one program.
_ROOM = 2**16
# Calls after which a program that takes rows, compiled in 60 ms and faster by 0.1 ms, is worth its
# time: more than a table of reduced models takes.
_OFTEN = 200


class SystemOutput(NamedTuple):
    """An output in the coordinates of the system that moves, which may be a reduced one."""

    q: Float[Array, "*k r"]
    v: Float[Array, "*k r"]
    chart: Float[Array, "*k"] | None  # of a system with charts: the one that q and v belong to
    violation: Float[Array, "*k"]  # largest |C| of the reduced system's own constraints


class Output(NamedTuple):
    """One output, or all of them with a leading axis."""

    q: Float[Array, "*k n"]  # physical
    v: Float[Array, "*k n"]
    violation: Float[Array, "*k"]  # largest |C| of the mechanism's own constraints
    reduced: SystemOutput | None  # None where the physical coordinates are the system's

    def in_system(self) -> SystemOutput:
        """Return the state in the coordinates of the system, reduced ones for a reduced system."""
        return self.reduced or SystemOutput(self.q, self.v, None, self.violation)


@eqx.filter_jit
def output_at(
    system: AbstractSystem, post_step: PostStep | None, t: Float[Array, ""], y: Any
) -> Output:
    """Return the output to save for an integrated state; jitted so that it is traced once.

    First-order states are in their places in q, as in an equilibrium, so that every verb takes the
    configuration of an output for what it is. On their integrals nothing depends.
    """
    q, v, *charts = y
    chart = charts[0] if charts else None
    local = local_system(system, post_step, y)
    own, full = local.structure, local.full.structure
    if local.full is local:
        return Output(own.with_states(q, v), v, _largest(local.constraint(t, q)), None)
    state = local.state(t, q, v)
    violation = _largest(local.full.constraint(t, state.q))
    reduced = SystemOutput(own.with_states(q, v), v, chart, _largest(local.constraint(t, q)))
    return Output(full.with_states(state.q, state.v), state.v, violation, reduced)


def _largest(violation: Float[Array, " m"]) -> Float[Array, ""]:
    return jnp.max(jnp.abs(violation), initial=0.0)


def capacity(count: int, width: int, dtype: Any) -> int:
    """Rows of `width` numbers to reserve for `count` outputs, so that few programs serve all."""
    least = _ROOM // (max(width, 1) * jnp.dtype(dtype).itemsize)
    return int(1 << (max(count, least, 2) - 1).bit_length())


def padded(x: Any, size: int) -> np.ndarray:
    """`x` with its last row repeated up to `size` rows."""
    rows = np.asarray(x)
    return np.concatenate([rows, np.broadcast_to(rows[-1:], (size - len(rows), *rows.shape[1:]))])


def strided(owner: str, stride: SupportsIndex, axes: int) -> tuple[slice, ...]:
    """Slices of runs and times, of so many `axes`, that keep every `stride`-th time; raises
    InputError, beginning with `owner`, for a stride that is no whole number above zero.
    """
    try:
        # A boolean is an index to Python.
        number = 0 if isinstance(stride, bool) else operator.index(stride)
    except TypeError:
        number = 0
    if number < 1:
        raise InputError(f"{owner}: stride = {stride!r} must be a whole number above zero.")
    return (*[slice(None)] * (axes - 1), slice(None, None, number))


_padded = IdentityCache()


def with_room(ts: Float[Array, " k"], size: int) -> Float[Array, " size"]:
    """Output times, the last one repeated; remembered with them."""
    times: Array | None = _padded.get(ts)
    if times is None or len(times) != size:
        times = _padded.put(ts, jax.device_put(padded(ts, size)))
    return times


def cut(outputs: Any, count: int) -> Any:
    """The first `count` rows of all arrays, without a program for each number of rows but for those
    that are asked for often.
    """
    leaves, tree = jax.tree.flatten(outputs)
    if leaves and len(leaves[0]) != count:
        if any(is_traced(x) for x in leaves):
            leaves = [x[:count] for x in leaves]
        elif next(_calls(count, tuple([x.shape for x in leaves]))) > _OFTEN:
            leaves = _first_rows(leaves, count)
        else:
            leaves = jax.device_put([np.asarray(x)[:count] for x in leaves])
    return jax.tree.unflatten(tree, leaves)


@functools.lru_cache
def _calls(count: int, shapes: tuple[tuple[int, ...], ...]) -> Iterator[int]:
    """Count how often so many rows of arrays of these shapes were asked for."""
    del count, shapes
    return itertools.count(1)


@functools.partial(jax.jit, static_argnums=1)
def _first_rows(leaves: list[Array], count: int) -> list[Array]:
    return [x[:count] for x in leaves]
