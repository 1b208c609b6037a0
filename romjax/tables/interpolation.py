"""Smooth functions of one variable, from their values at equally spaced nodes."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A node's derivatives are those of the polynomial through so many nodes on each side of it.
_SIDE = 6
# Derivatives that polynomials on either side of a node have in common.
_SMOOTH = 3
# Nodes before the first interval and after the last one.
BEFORE, AFTER = _SIDE, _SIDE


@functools.cache
def _stencil() -> np.ndarray:
    """Coefficients (8, 14), highest power first, on one interval from the values around it.

    Hermite's polynomial of degree seven: it has the values and three derivatives of both ends.
    """
    # Here, since scipy.interpolate takes long to load and few ask for tables.
    from scipy.interpolate import BarycentricInterpolator, BPoly, PPoly

    around = np.arange(-_SIDE, _SIDE + 1)
    by_values = BarycentricInterpolator(around, np.eye(len(around)))
    weights = by_values.derivatives(0.0, _SMOOTH + 1)
    ends = np.zeros((2, _SMOOTH + 1, len(around) + 1))
    ends[0, :, :-1] = ends[1, :, 1:] = weights
    coefficients: np.ndarray = PPoly.from_bernstein_basis(BPoly.from_derivatives([0, 1], ends)).c
    return coefficients[:, 0]


def polynomials(values: Float[Array, "P *c"]) -> Float[Array, "N p *c"]:
    """On each of the N = P − BEFORE − AFTER − 1 intervals, highest power first."""
    width = BEFORE + AFTER + 2
    windows = np.arange(len(values) - width + 1)[:, None] + np.arange(width)
    # Differences to the first end: else rounding of the values would be as large as these.
    origin = values[BEFORE : len(values) - AFTER - 1]
    stencil = jnp.asarray(_stencil(), values.dtype)
    coefficients = jnp.tensordot(values[windows] - origin[:, None], stencil, (1, 1))
    return jnp.moveaxis(coefficients, -1, 1).at[:, -1].add(origin)


def evaluate(
    coefficients: Float[Array, "p c"], u: Float[Array, ""]
) -> tuple[Float[Array, " c"], Float[Array, " c"], Float[Array, " c"]]:
    """A polynomial and its first two derivatives, by Horner's scheme, where the share `u` of its
    interval is past.
    """
    third, second, first, *others = coefficients
    value, slope, half = (third * u + second) * u + first, 2 * third * u + second, third
    for row in others:
        half = half * u + slope
        slope = slope * u + value
        value = value * u + row
    return value, slope, 2 * half
