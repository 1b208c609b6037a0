"""The way from one snapshot to the next, followed in a chart."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...common import precision
from ...common.arrays import as_jax
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from .chart import Chart

# Points of the way from one snapshot to the next, a whole turn of a crank at most, and steps of
# Newton's method for each.
_POINTS, _STEPS = 32, 8
# The way has arrived if it ends so near the next snapshot, as a share of the coordinates.
_ARRIVED = 1e-5


class Way(NamedTuple):
    """Configurations q (P, n) at the times t (P,), one near the other."""

    t: np.ndarray
    q: np.ndarray


def followed(system: AbstractSystem, chart: Chart, t: np.ndarray, q: np.ndarray) -> Way | None:
    """Follow the independent coordinates of a chart straight from each snapshot to the next.

    None if that does not lead there, as across a singular position of the chart.
    """
    times, points, arrived = _follow(system, chart, as_jax(t), as_jax(q))
    if not np.all(np.asarray(arrived)):
        return None
    return Way(np.asarray(times).reshape(-1), np.asarray(points).reshape(-1, system.n))


@program_once
def _follow(
    system: AbstractSystem, chart: Chart, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> tuple[Float[Array, "k points"], Float[Array, "k points n"], Bool[Array, " k"]]:
    parts = chart.independent, chart.dependent, chart.read
    independent, dependent, read = (jnp.asarray(x, q.dtype) for x in parts)
    limits = precision.of(q.dtype)

    def one(t0: Array, q0: Array, t1: Array, q1: Array) -> tuple[Array, Array, Array]:
        # The way is straight in the independent coordinates; Newton's method adds the others.
        along = multiply(independent, multiply(read, q1 - q0))

        def point(before: Array, share: Array) -> tuple[Array, tuple[Array, Array, Array]]:
            now, q = t0 + share * (t1 - t0), before + along / _POINTS

            def newton(q: Array, _: None) -> tuple[Array, Array]:
                step, size = chart.step(system, now, q)
                return q - multiply(dependent, step), size

            q, sizes = jax.lax.scan(newton, q, None, length=_STEPS)
            return q, (now, q, sizes[-1] <= limits.newton_accepted)

        shares = jnp.arange(1, _POINTS + 1, dtype=q.dtype) / _POINTS
        last, (times, points, converged) = jax.lax.scan(point, q0, shares)
        beside = jnp.max(jnp.abs(last - q1))
        arrived = jnp.all(converged) & (beside <= _ARRIVED * (1 + jnp.max(jnp.abs(q1))))
        return times, points, arrived

    return jax.vmap(one)(t[:-1], q[:-1], t[1:], q[1:])
