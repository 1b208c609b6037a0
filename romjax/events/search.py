"""The first event within a step, by dense output."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

# Dense output is looked at so many times in each step; excursions between two are not seen.
_NODES = 8
# Bisections of the part of a step in which an event lies: dense output knows it no better.
_BISECTIONS = 24


class Crossings(NamedTuple):
    """The first part of a step in which a quantity crosses its level.

    - `exists`: whether there is one. `is_last`: whether it is that at the end of the step.
    - `share`: of the step up to the first crossing.
    - `sign` (events,): of those quantities that cross in it, before they do; 0 of others.
    """

    exists: Bool[Array, ""]
    is_last: Bool[Array, ""]
    share: Float[Array, ""]
    sign: Float[Array, " events"]


def first_crossing(
    at: Callable[[Float[Array, ""]], Float[Array, " events"]],
    side: Float[Array, " events"],
    end: Float[Array, " events"],
    noise: Float[Array, " events"],
    falling: Bool[Array, " events"],
    rising: Bool[Array, " events"],
) -> Crossings:
    """Where in a step one of the quantities `at` a share of it first crosses zero.

    `side`: where each starts, 0 for what cannot cross. `end`: their values at the end. `noise`: of
    the values. `falling`, `rising`: the directions that count.
    """
    inner = jax.lax.map(at, jnp.arange(1, _NODES) / _NODES)
    values = jnp.concatenate([side[None], inner, end[None]])

    def crosses(before: Array, after: Array) -> Array:
        falls = falling & (before >= -noise) & (after < -noise)
        rises = rising & (before <= noise) & (after > noise)
        return jnp.where(side != 0, jnp.where(falls, 1.0, jnp.where(rises, -1.0, 0.0)), 0.0)

    signs = jax.vmap(crosses)(values[:-1], values[1:])
    exists, part = jnp.any(signs != 0), jnp.argmax(jnp.any(signs != 0, axis=1))
    sign = signs[part]

    def halve(_: Any, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        # Positive as long as none of them has crossed.
        is_before = jnp.min(jnp.where(sign != 0, sign * at(middle), jnp.inf)) > 0
        return jnp.where(is_before, middle, low), jnp.where(is_before, high, middle)

    count = jnp.where(exists, _BISECTIONS, 0)
    _, share = jax.lax.fori_loop(0, count, halve, (part / _NODES, (part + 1) / _NODES))
    return Crossings(exists, part == _NODES - 1, share, sign)
