"""What Newton's method in a chart starts from, for another system."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...common import precision
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...linalg.quaternions import columns as quaternion_columns
from ...system.base import AbstractSystem
from .chart import Chart

# Steps of Newton's method, each with its own matrix.
_STEPS = 8
# Points of the way from where another system starts to the first snapshot, and the number of those
# that Newton's method may start from.
_POINTS = 32
WAY = 16


class Guesses(NamedTuple):
    """Configurations q = q̄ + Y Φ z + W d that snapshots have, in the order of time."""

    offset: Float[Array, " n"]  # q̄
    modes: Float[Array, "n r"]  # Y Φ
    dual: Float[Array, "r n"]  # z of a displacement
    z: Float[Array, "K r"]
    d: Float[Array, "K m"]
    times: Float[Array, " K"]
    pace: Float[Array, ""]  # of d along the drives; zero without any


def with_way(x: Float[Array, "K ..."]) -> Float[Array, "W ..."]:
    """What snapshots have, after as many copies of the first as there are points of a way to it."""
    return jnp.concatenate([jnp.repeat(x[:1], WAY, axis=0), x])


@program_once
def guesses_of(
    chart: Chart, guesses: Guesses, full: AbstractSystem, from_start: bool
) -> tuple[Float[Array, "W r"], Float[Array, "W m"], Float[Array, "W m m"]]:
    """The z, d and (C_q W)⁻¹ of another system on the way to the snapshots, and at the z of these.

    Other drives put a mechanism somewhere else at the same time, many turns from it after a while;
    other clamps do so from the start on, to which the way from where the other system starts is
    added. So each d begins where the one before has gone; what is not found stays as it was.
    """
    lead, passed = jnp.zeros_like(guesses.d[0]), (guesses.d, guesses.times, guesses.z)
    if from_start:
        away = _nearest_signs(full, guesses.offset) - guesses.offset
        lead = chart.dependent_of(away) - guesses.d[0]
        z, shares = multiply(guesses.dual, away), jnp.arange(_POINTS, dtype=away.dtype) / _POINTS
        way = z[None] + shares[:, None] * (guesses.z[:1] - z[None])
        first = (jnp.repeat(x[:1], _POINTS, axis=0) for x in passed[:2])
        passed = jax.tree.map(lambda *x: jnp.concatenate(x), (*first, way), passed)
    dependent = jnp.asarray(chart.dependent, lead.dtype)

    def configuration(z: Array, d: Array) -> Array:
        return guesses.offset + multiply(guesses.modes, z) + multiply(dependent, d)

    def follow(lead: Array, snapshot: Any) -> tuple[Array, tuple[Array, Array]]:
        own, t, z = snapshot

        def newton(d: Array, _: None) -> tuple[Array, Array]:
            step, size = chart.step(full, t, configuration(z, d))
            return d - step, size

        d, steps = jax.lax.scan(newton, own + lead, None, length=_STEPS)
        converged: Bool[Array, ""] = steps[-1] <= precision.of(d.dtype).newton_accepted
        d = jnp.where(converged, d, own)
        return d - own, (d, converged)

    _, (d, converged) = jax.lax.scan(follow, lead, passed)
    # Without drives the guesses of the other system are as good as they were, where no way leads
    # from its start to them.
    count = len(d) - len(guesses.d)
    leads = jnp.all(converged[:count]) & from_start
    moved = (converged[count:] & ((guesses.pace > 0) | leads))[:, None]
    all_z, all_d = guesses.z, jnp.where(moved, d[count:], guesses.d)
    if from_start:
        # Near where the other system starts no snapshot need be.
        ways = [x[: count : count // WAY] for x in (passed[2], d)]
        all_z, all_d = (
            jnp.concatenate([jnp.where(leads, ahead, x[:1]), x])
            for ahead, x in zip(ways, (all_z, all_d), strict=True)
        )
    else:
        all_z, all_d = with_way(all_z), with_way(all_d)
    times, q = with_way(guesses.times), jax.vmap(configuration)(all_z, all_d)
    return all_z, all_d, chart.dependent_inverses(full, times, q)


def _nearest_signs(full: AbstractSystem, other: Float[Array, " n"]) -> Float[Array, " n"]:
    """The start of a system, with those quaternions, of which p and −p are the same turn, that are
    nearer to other ones.
    """
    q = full.q0
    if not full.structure.quaternions:
        return q
    table = quaternion_columns(full.structure.quaternions)
    opposed = jnp.sum(q[table] * other[table], axis=1, keepdims=True) < 0
    return q.at[table].multiply(jnp.where(opposed, -1.0, 1.0))
