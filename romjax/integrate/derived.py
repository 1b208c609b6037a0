"""Quantities that follow from a run and its system, evaluated with the run or on demand."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..common.compat import is_outermost, is_traced
from ..common.identity_cache import IdentityCache
from ..common.partition import Partitioned
from ..compiling.program import program, program_once
from ..linalg import quaternions
from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.stabilization import Baumgarte
from ..system.structure import without_names
from .chart_change import ChartChange
from .outputs import capacity, cut, padded
from .signature import signature

# States of effects have no inertia. This share of the largest one keeps the metric positive
# definite, and is too small to count in any error or basis.
_STATE = 1e-30


class EagerQuantities(NamedTuple):
    """Quantities that were evaluated with the run.

    - `multipliers` (k, m), `metric` (n, n): as `Trajectory` has them.
    - `parts`: of the system that moved; None within transformations, where nobody asks for it.
    - `numbers`: the signature of its numbers, in the place of its parts; None where nobody knows.
    """

    multipliers: Float[Array, "k m"]
    metric: Float[Array, "n n"]
    parts: Partitioned | None = None
    numbers: Float[Array, ""] | None = None

    @property
    def signature(self) -> Float[Array | np.ndarray, ""] | None:
        """The signature of the numbers of the system that moved; None where nobody knows them."""
        return self.numbers if self.parts is None else signature(self.parts.combine())

    def every(self, kept: tuple[slice, ...]) -> "EagerQuantities":
        """Return the object for the output times that are `kept`, by slices of runs and times."""
        return self._replace(multipliers=self.multipliers[kept])


class LazyQuantities(eqx.Module):
    """Quantities that are evaluated when they are asked for: most runs are never asked.

    Multipliers need the acceleration at each output time, which is a quarter of a simulation's
    program and, in a long chain, half of its time.
    """

    parts: Partitioned  # of the system, with its names
    t: Float[Array, " k"]
    q: Float[Array, "k r"]
    v: Float[Array, "k r"]
    chart: Float[Array, " k"] | None
    stabilization: Baumgarte | None

    @property
    def system(self) -> AbstractSystem:
        """The system that moved, without names."""
        system: AbstractSystem = without_names(self.parts.combine())
        return system

    @property
    def signature(self) -> Float[Array | np.ndarray, ""]:
        """The signature of the numbers of the system that moved."""
        return signature(self.parts.combine())

    @property
    def multipliers(self) -> Float[Array, "k m"]:
        if self.t.ndim > 1:  # several runs, stacked
            stacked: Float[Array, "runs k m"] = jax.vmap(lambda run: run.multipliers)(self)
            return stacked
        k, system = len(self.t), self.system
        if system.m == 0:
            return jnp.zeros((k, 0), self.q.dtype)
        size = capacity(k, system.m, self.q.dtype)
        states = (self.t, self.q, self.v, self.chart)
        if any(is_traced(x) for x in jax.tree.leaves(states)):
            return multipliers_along(system, *states, self.stabilization)
        t, q, v, chart = jax.tree.map(lambda x: padded(x, size), states)
        count = np.asarray(k)
        multipliers = _multipliers(system, t, q, v, chart, self.stabilization, count)
        rows: Float[Array, "k m"] = cut(multipliers, k)
        return rows

    @property
    def metric(self) -> Float[Array, "n n"]:
        if self.t.ndim > 1:
            stacked: Float[Array, "runs n n"] = jax.vmap(lambda run: run.metric)(self)
            return stacked
        if not is_outermost() or any(is_traced(x) for x in self.parts.arrays):
            traced: Float[Array, "n n"] = _metric(self.system)
            return traced
        known: Float[Array, "n n"] | None = _metrics.get(self.parts)
        return _metrics.put(self.parts, _metric(self.system)) if known is None else known

    def every(self, kept: tuple[slice, ...]) -> "LazyQuantities":
        """Return the object for the output times that are `kept`, by slices of runs and times."""
        arrays = {name: getattr(self, name) for name in ("t", "q", "v", "chart")}
        return dataclasses.replace(self, **jax.tree.map(lambda x: x[kept], arrays))


@program
def _multipliers(
    system: AbstractSystem,
    t: Float[Array, " size"],
    q: Float[Array, "size r"],
    v: Float[Array, "size r"],
    chart: Float[Array, " size"] | None,
    stabilization: Baumgarte | None,
    count: Int[Array | np.ndarray, ""],
) -> Float[Array, "size m"]:
    def put(i: Array, rows: Array) -> Array:
        now = None if chart is None else chart[i]
        row = multipliers_at(system, t[i], q[i], v[i], now, stabilization)
        after: Array = jax.lax.dynamic_update_index_in_dim(rows, row, i, 0)
        return after

    # A loop, not a batch, whose program is larger.
    rows: Array = jax.lax.fori_loop(
        0, jnp.asarray(count), put, jnp.zeros((len(t), system.m), q.dtype)
    )
    return rows


def multipliers_at(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " r"],
    v: Float[Array, " r"],
    chart: Float[Array, ""] | None,
    stabilization: Baumgarte | None,
) -> Float[Array, " m"]:
    """The multipliers at one state."""
    if has_charts(system):
        system = ChartChange.of(system).in_chart(system, chart)
    return solve(system, t, q, v, stabilization).multipliers


def multipliers_along(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k r"],
    v: Float[Array, "k r"],
    chart: Float[Array, " k"] | None,
    stabilization: Baumgarte | None,
) -> Float[Array, "k m"]:
    """The multipliers at some states, within transformations of JAX: reverse mode goes through."""
    rows: Float[Array, "k m"] = jax.vmap(
        lambda t, q, v, chart: multipliers_at(system, t, q, v, chart, stabilization)
    )(t, q, v, chart)
    return rows


# Runs of one system are compared again and again.
_metrics = IdentityCache()


@program_once
def _metric(system: AbstractSystem) -> Float[Array, "n n"]:
    return metric_of(system)


def metric_of(system: AbstractSystem) -> Float[Array, "n n"]:
    """The physical mass matrix at the start of a system; of each quaternion, of unit length, the
    mean of its eigenvalues 4/3 tr J, so that turns about all axes count alike.
    """
    full = system.full
    metric = full.mass(full.q0)
    if full.structure.states:
        moving = ~full.structure.is_state
        largest = jnp.max(jnp.diagonal(metric), where=jnp.asarray(moving), initial=0.0)
        metric = metric * jnp.asarray(np.outer(moving, moving), metric.dtype)
        metric += jnp.diag(jnp.where(moving, 0, _STATE * largest))
    if not full.structure.quaternions:
        return metric
    table = quaternions.columns(full.structure.quaternions)
    # Quaternions are taken out of the matrix, with all that couples with them, and put back as
    # multiples of the identity.
    others = np.ones(full.n)
    others[table] = 0
    means = jnp.mean(jnp.diagonal(metric)[table], axis=1) * jnp.sum(full.q0[table] ** 2, axis=1)
    turning = jnp.zeros_like(full.q0).at[table].set(means[:, None])
    return metric * jnp.asarray(np.outer(others, others), metric.dtype) + jnp.diag(turning)
