"""The first event within a step, by dense output."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# Points of each step at which dense output is evaluated, for values and for rates; the inner ones
# are off equal parts by up to this share of a part, so that no oscillation is in step with all. Of
# 2535 sines of 20 to 1000 periods in a step, 7 that cross pass for resolved by equal parts, and 1
# by these.
_NODES, _UNEQUAL = 8, 0.25
# A quantity at this share of the way between two nodes, and a cubic through their values and rates,
# differ by less than the second share of how the values change, or it oscillates between them. A
# sine does not differ by so much if a step has one period of it at most. The first share is the
# golden section: no multiple of it is near a whole number, so that `_nodes` repeats no distance.
_BETWEEN, _SMOOTH = 0.381966, 0.01
# One that differs by so many times less than it is far from its level does not cross it.
_MANY = 8.0
# Bisections of the part of a step in which an event lies; more would be finer than the errors of
# dense output.
_BISECTIONS = 24


class Crossings(NamedTuple):
    """The first part of a step in which a quantity crosses its level.

    - `exists`: whether there is one. `is_last`: whether it is that at the end of the step.
    - `share`: of the step up to the first crossing.
    - `sign` (events,): of those quantities that cross in it, before they do; 0 of others.
    - `is_resolved`: whether no quantity oscillates so often that crossings may be missed.
    """

    exists: Bool[Array, ""]
    is_last: Bool[Array, ""]
    share: Float[Array, ""]
    sign: Float[Array, " events"]
    is_resolved: Bool[Array, ""]


class _Points(NamedTuple):
    """The points of a step at which quantities were evaluated, each at points of its own."""

    shares: Float[Array, "points events"]
    values: Float[Array, "points events"]
    are_resolved: Bool[Array, " events"]


def first_crossing(
    at: Callable[[Float[Array, ""]], Float[Array, " events"]],
    side: Float[Array, " events"],
    end: Float[Array, " events"],
    noise: Float[Array, " events"],
    falling: Bool[Array, " events"],
    rising: Bool[Array, " events"],
    bisections: int = _BISECTIONS,
) -> Crossings:
    """Find where in a step one of the quantities `at` a share of it first crosses zero.

    A quantity that comes near its level and goes away between two looks may have crossed it twice:
    it is followed to where it turns.

    `side`: where each starts, 0 for what cannot cross. `end`: their values at the end. `noise`: of
    the values. `falling`, `rising`: the directions that count. `bisections`: of the part it is in.
    """
    points = _look(at, side, end, noise, bisections)

    def crosses(before: Array, after: Array) -> Array:
        falls = falling & (before >= -noise) & (after < -noise)
        rises = rising & (before <= noise) & (after > noise)
        return jnp.where(side != 0, jnp.where(falls, 1.0, jnp.where(rises, -1.0, 0.0)), 0.0)

    signs = jax.vmap(crosses)(points.values[:-1], points.values[1:])
    exists, part = jnp.any(signs != 0, axis=0), jnp.argmax(signs != 0, axis=0)
    sign, low, high = (_each(x, part) for x in (signs, points.shares[:-1], points.shares[1:]))

    def halve(_: Any, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        is_before = sign * _each_at(at, middle) > 0
        return jnp.where(is_before, middle, low), jnp.where(is_before, high, middle)

    count = jnp.where(jnp.any(exists), bisections, 0)
    _, share = jax.lax.fori_loop(0, count, halve, (low, high))
    first = jnp.argmin(jnp.where(exists, share, jnp.inf))
    # Two points in each part.
    together = exists & (part // 2 == part[first] // 2)
    return Crossings(
        jnp.any(exists),
        part[first] == 2 * _NODES - 1,
        share[first],
        jnp.where(together, sign, 0.0),
        jnp.all(points.are_resolved | (side == 0)),
    )


def _look(
    at: Callable[[Float[Array, ""]], Float[Array, " events"]],
    side: Float[Array, " events"],
    end: Float[Array, " events"],
    noise: Float[Array, " events"],
    bisections: int,
) -> _Points:
    """The quantities at the nodes of a step, and between two of them where they turn away from
    their level, or at the first of the two again.
    """

    def look(share: Array) -> tuple[Array, Array]:
        value, rate = jax.jvp(at, (share,), (jnp.ones_like(share),))
        return value, rate

    nodes = _nodes(side.dtype)
    parts = jnp.diff(nodes)
    values, rates = jax.lax.map(look, nodes)
    between = jax.lax.map(at, nodes[:-1] + _BETWEEN * parts)
    are_resolved = _are_resolved(values, rates, parts[:, None], between, noise)
    values = values.at[0].set(side).at[-1].set(end)

    def turn(i: Array) -> tuple[Array, Array]:
        before, after = rates[i], rates[i + 1]
        # One that is at its level there comes from where it does not go.
        sign = jnp.where(jnp.abs(values[i]) > noise, jnp.sign(values[i]), -jnp.sign(before))
        turns = (sign * before < 0) & (sign * after > 0) & (sign * values[i + 1] > noise)

        def halve(_: Any, bracket: tuple[Array, ...]) -> tuple[Array, ...]:
            low, high, share, value = bracket
            middle = 0.5 * (low + high)
            here, rate = _each_at(look, middle)
            deeper = sign * here < sign * value
            return (
                jnp.where(sign * rate < 0, middle, low),
                jnp.where(sign * rate < 0, high, middle),
                jnp.where(deeper, middle, share),
                jnp.where(deeper, here, value),
            )

        start = jnp.full_like(side, nodes[i]), jnp.full_like(side, nodes[i + 1])
        count = jnp.where(jnp.any(turns), bisections, 0)
        *_, share, value = jax.lax.fori_loop(0, count, halve, (*start, start[0], values[i]))
        return jnp.where(turns, share, nodes[i]), jnp.where(turns, value, values[i])

    shares, turned = jax.lax.map(turn, jnp.arange(_NODES))
    spread = jnp.broadcast_to(nodes[:, None], values.shape)
    return _Points(_alternating(spread, shares), _alternating(values, turned), are_resolved)


def _nodes(dtype: Any) -> Float[Array, " nodes"]:
    """Shares of a step, from 0 to 1."""
    inside = np.arange(1, _NODES)
    moved = _UNEQUAL * (2 * np.modf(_BETWEEN * inside)[0] - 1)
    return jnp.asarray(np.concatenate([[0], inside + moved, [_NODES]]) / _NODES, dtype)


def _are_resolved(values: Array, rates: Array, parts: Array, between: Array, noise: Array) -> Array:
    """Whether quantities (nodes, events) are what a cubic through their values and rates is between
    nodes, `parts` of the step apart; or differ so little from it, even many times over, that they
    stay on one side.
    """
    before, after, s = values[:-1], values[1:], _BETWEEN
    start, end = parts * rates[:-1], parts * rates[1:]
    cubic = before + s**2 * (3 - 2 * s) * (after - before)
    cubic += s * (1 - s) * ((1 - s) * start - s * end)
    # Two straight pieces, as of a distance, are no oscillation either.
    left, right = before + s * start, after - (1 - s) * end
    off = jnp.min(jnp.abs(between[None] - jnp.stack([cubic, left, right])), axis=0)
    change = jnp.abs(after - before) + jnp.abs(between - before) + noise[None]
    distance = jnp.minimum(jnp.minimum(jnp.abs(before), jnp.abs(after)), jnp.abs(between))
    return jnp.all((off <= _SMOOTH * change) | (distance > _MANY * off), axis=0)


def _alternating(nodes: Array, between: Array) -> Array:
    """Rows of nodes, each but the last followed by one between it and the next."""
    pairs = jnp.stack([nodes[:-1], between], axis=1).reshape(-1, nodes.shape[1])
    return jnp.concatenate([pairs, nodes[-1:]])


def _each(rows: Array, index: Array) -> Array:
    """Return from each column the entry in the row that `index` gives for it."""
    return jnp.take_along_axis(rows, index[None], axis=0)[0]


def _each_at(function: Callable[[Array], Any], shares: Array) -> Any:
    """Evaluate each quantity of `function` at a share of the step of its own."""
    return jax.tree.map(jnp.diagonal, jax.vmap(function)(shares))
