"""Smooth functions of one or two variables, from their values at equally spaced nodes."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...linalg.dense import multiply

# A node's derivatives are those of the polynomial through so many nodes on each side of it; next
# to an end, through as many nodes in all.
SIDE = 5
_WINDOW = 2 * SIDE + 1
# Derivatives that polynomials on either side of a node have in common.
_SMOOTH = 3


@functools.cache
def _weights() -> np.ndarray:
    """Values and derivatives (11, 4, 11) at each node of a window, from the values in it."""
    # Here, since scipy.interpolate takes long to load and few ask for tables.
    from scipy.interpolate import BarycentricInterpolator

    nodes = np.arange(_WINDOW)
    by_values = BarycentricInterpolator(nodes - SIDE, np.eye(_WINDOW))
    return np.stack([by_values.derivatives(float(x - SIDE), _SMOOTH + 1) for x in nodes])


@functools.cache
def _hermite() -> np.ndarray:
    """Coefficients (8, 8), highest power first, of the polynomial of degree seven that has the
    values and three derivatives of both ends of an interval.
    """
    from scipy.interpolate import BPoly, PPoly

    size = _SMOOTH + 1
    ends = np.zeros((2, size, 2 * size))
    ends[0, :, :size] = ends[1, :, size:] = np.eye(size)
    coefficients: np.ndarray = PPoly.from_bernstein_basis(BPoly.from_derivatives([0, 1], ends)).c
    return coefficients[:, 0]


def polynomials(values: Float[Array, "P *c"], periodic: bool = False) -> Float[Array, "N p *c"]:
    """Return a polynomial for each of the N = P − 1 intervals between nodes, highest power first.

    `periodic`: without the first and the last `SIDE` intervals, whose nodes repeat others.
    """
    count = len(values)
    starts = np.clip(np.arange(count) - SIDE, 0, count - _WINDOW)
    windows, within = starts[:, None] + np.arange(_WINDOW), np.arange(count) - starts
    # Differences to the node: else rounding of the values would be as large as these.
    differences = values[windows] - values[:, None]
    weights = jnp.asarray(_weights()[within], values.dtype)
    derivatives = jnp.einsum("psw,pw...->ps...", weights, differences)
    # Derivatives at the end of an interval are of differences to that end; its value is taken
    # against the start, as that of the start is.
    last = derivatives[1:].at[:, 0].add(jnp.diff(values, axis=0))
    ends = jnp.concatenate([derivatives[:-1], last], axis=1)
    hermite = jnp.asarray(_hermite(), values.dtype)
    coefficients = jnp.moveaxis(jnp.tensordot(ends, hermite, (1, 1)), -1, 1)
    coefficients = coefficients.at[:, -1].add(values[:-1])
    return coefficients[SIDE:-SIDE] if periodic else coefficients


def patches(
    values: Float[Array, "..."], directions: int, periodic: bool = False
) -> Float[Array, "..."]:
    """The polynomials of one or two variables: `polynomials` in one direction after the other.

    Values (*nodes, c) give coefficients (*intervals, *powers, c).
    """
    if directions == 1:
        return polynomials(values, periodic)
    first = jnp.moveaxis(polynomials(values, periodic), 2, 0)  # (P, N, p, c)
    return jnp.moveaxis(polynomials(first, periodic), (0, 1), (1, 3))


def evaluate(
    coefficients: Float[Array, "..."], u: Float[Array, " d"]
) -> tuple[Float[Array, " c"], Float[Array, "d c"], Float[Array, "d d c"]]:
    """A polynomial (p, c) or (p, p, c) and its first two derivatives, where the shares `u` of its
    interval are past.
    """
    if len(u) == 1:
        value, slope, bend = _horner(coefficients, u[0])
        return value, slope[None], bend[None, None]
    # Many numbers at once, for which one product is faster than as many of Horner's schemes.
    rows = multiply(_powers(u[0], len(coefficients)), coefficients.reshape(len(coefficients), -1))
    value, slope, bend = rows.reshape(3, *coefficients.shape[1:])
    value, others, other_bends = evaluate(value, u[1:])
    slope, mixed, _ = evaluate(slope, u[1:])
    bend, _, _ = evaluate(bend, u[1:])
    upper = jnp.concatenate([bend[None], mixed])
    lower = jnp.concatenate([mixed[:, None], other_bends], axis=1)
    return value, jnp.concatenate([slope[None], others]), jnp.concatenate([upper[None], lower])


def _horner(
    coefficients: Float[Array, "p c"], u: Float[Array, ""]
) -> tuple[Float[Array, " c"], Float[Array, " c"], Float[Array, " c"]]:
    """A polynomial and its first two derivatives, by Horner's scheme."""
    third, second, first, *others = coefficients
    value, slope, half = (third * u + second) * u + first, 2 * third * u + second, third
    # Synthetic division three times over: `half` is half of the second derivative.
    for row in others:
        half = half * u + slope
        slope = slope * u + value
        value = value * u + row
    return value, slope, 2 * half


def _powers(u: Float[Array, ""], count: int) -> Float[Array, "3 p"]:
    """The powers of u, highest first, and their first two derivatives."""
    powers = [jnp.ones_like(u)]
    for _ in range(count - 1):
        powers.append(powers[-1] * u)
    value, exponents = jnp.stack(powers[::-1]), np.arange(count - 1, -1, -1.0)
    slope = exponents * jnp.append(value[1:], 0)
    return jnp.stack([value, slope, exponents * jnp.append(slope[1:], 0)])
