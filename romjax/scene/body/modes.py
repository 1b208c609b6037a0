"""Bending modes of a uniform Euler–Bernoulli beam: static ones, or natural ones by the support."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .free_modes import derivative, free_modes

SHAPES = ("static", "free-free", "clamped-free", "pinned-free")
# Shapes that are orthogonal to rigid motion.
FREE = SHAPES[:2]


def bending_roots(shapes: str, count: int) -> np.ndarray:
    """The first `count` positive roots b = βL of the frequency equation, ω² = b⁴ EI / (m L³).

    Free: cos b cosh b = 1; clamped: cos b cosh b = −1; pinned: tan b = tanh b. By Newton on forms
    whose terms stay of order one, from the asymptotes. Static: what their frequencies come from.
    """
    if shapes == "static":
        squares: np.ndarray = free_modes(2, count).squares
        return squares**0.25
    start = {"free-free": 0.5, "clamped-free": -0.5, "pinned-free": 0.25}[shapes]
    roots = []
    for k in range(1, count + 1):
        x = (k + start) * math.pi
        # Four steps reach rounding from the first clamped root's asymptote, which is off by a sixth
        # of the root, and from all others fewer.
        for _ in range(8):
            c, s, sech, tanh = math.cos(x), math.sin(x), 1 / math.cosh(x), math.tanh(x)
            if shapes == "pinned-free":
                x -= (s - c * tanh) / (c + s * tanh - c * sech**2)
            else:
                sign = -1 if shapes == "free-free" else 1
                x -= (c + sign * sech) / (-s - sign * sech * tanh)
        roots.append(x)
    return np.array(roots)


def _coefficients(shapes: str, roots: np.ndarray) -> np.ndarray:
    """Return the coefficients (4, modes) of cos bξ, sin bξ, exp(−bξ) and exp(b(ξ−1)), 0 ≤ ξ ≤ 1.

    These four are of order one for every mode, where the textbook form cosh − σ sinh cancels all
    digits from the tenth on. ∫w² dξ = 1, which at a free end means w = ±2.
    """
    columns = []
    for b in roots:
        c, s, e = math.cos(b), math.sin(b), math.exp(-b)
        # w, w'/b, w''/b² and w'''/b³ at ξ = 0, and below the last two at ξ = 1, by the four
        # functions.
        value, slope, moment, shear = (
            [1, 0, 1, e],
            [0, 1, -1, e],
            [-1, 0, 1, e],
            [0, -1, -1, e],
        )
        lower = {
            "free-free": (moment, shear),
            "clamped-free": (value, slope),
            "pinned-free": (value, moment),
        }[shapes]
        # Four conditions on four coefficients, singular at a root: the last right singular vector
        # solves them.
        column = np.linalg.svd(np.array([*lower, [-c, -s, e, 1], [s, -c, -e, 1]]))[2][3]
        end = value if shapes == "free-free" else [c, s, e, 1]
        columns.append(2 * column / (column @ np.array(end)))
    return np.array(columns).reshape(-1, 4).T


def bending_shapes(shapes: str, count: int, xi: Any, xp: Any = jnp) -> tuple[Any, Any]:
    """Deflections w and slopes dw/dξ of the modes, (modes,), at `xi`, 0 to 1 on the beam.

    ∫w² dξ = 1. Every natural mode is 2 at its free end; at the lower one if both are free. With
    NumPy as `xp`, for a ξ that is not traced: then nothing is.
    """
    if shapes == "static":
        series = free_modes(2, count).series
        return derivative(series, xi), derivative(series, xi, 1)
    b = bending_roots(shapes, count)
    cosine, sine, left, right = _coefficients(shapes, b)
    c, s = xp.cos(b * xi), xp.sin(b * xi)
    falling, rising = left * xp.exp(-b * xi), right * xp.exp(b * (xi - 1))
    deflection = cosine * c + sine * s + falling + rising
    slope = b * (sine * c - cosine * s - falling + rising)
    return deflection, slope


def bending_moments(shapes: str, count: int) -> np.ndarray:
    """∫w dξ and ∫(ξ − ½) w dξ of the modes, (2, modes).

    By parts from w'''' = b⁴ w, so that only shear and bending moment of the lower end remain.
    """
    if shapes in FREE:
        return np.zeros((2, count))
    b = bending_roots(shapes, count)
    cosine, sine, left, right = _coefficients(shapes, b)
    right = right * np.exp(-b)
    moment, shear = (left + right - cosine) / b**2, (right - left - sine) / b
    return np.stack([-shear, moment + shear / 2])


def anchor(shapes: str) -> float:
    """The ξ whose point does not move along the axis as the beam foreshortens."""
    return 0.5 if shapes in FREE else 0.0


def foreshortening(shapes: str, count: int, xi: Float[Array, ""]) -> Float[Array, "modes modes"]:
    """∫w'_k w'_l dξ from the anchor to `xi`, by a quadrature that is exact to rounding."""
    nodes, weights = _quadrature(count)
    start = anchor(shapes)
    points = start + (xi - start) * nodes
    _, slopes = jax.vmap(lambda point: bending_shapes(shapes, count, point))(points)
    return (xi - start) * jnp.einsum("i,ik,il->kl", weights, slopes, slopes)


def foreshortening_moments(shapes: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """∫G dξ and ∫(ξ − ½) G dξ of G = `foreshortening`, both (modes, modes).

    The order of integration is exchanged: each w'_k w'_l dη counts for all that lies outside of it.
    """
    nodes, weights = _quadrature(count)
    middle, mean, lever = anchor(shapes), np.zeros((count, count)), np.zeros((count, count))
    for start, end in ((0.0, middle), (middle, 1.0)):
        points = start + (end - start) * nodes
        _, slopes = bending_shapes(shapes, count, points[:, None], np)
        outside = -points if end == middle else 1 - points
        share = (end - start) * weights
        mean += np.einsum("i,ik,il->kl", share * outside, slopes, slopes)
        lever += np.einsum("i,ik,il->kl", share * points * (1 - points) / 2, slopes, slopes)
    return mean, lever


def _quadrature(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre on 0 to 1 with nodes enough for products of slopes of all modes."""
    nodes, weights = np.polynomial.legendre.leggauss(8 * count + 16)
    return (nodes + 1) / 2, weights / 2
