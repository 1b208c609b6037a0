"""Modes of a free uniform beam that are exact under static loads at its ends."""

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre


class FreeModes(NamedTuple):
    """Polynomials p(ξ) with ∫p_k p_l dξ = δ_kl, ξ from 0 to 1, by rising frequency."""

    squares: np.ndarray  # ∫(dʳp/dξʳ)² dξ, (count,)
    series: np.ndarray  # in Legendre polynomials of 2ξ − 1, (degrees, count)


def free_modes(order: int, count: int) -> FreeModes:
    """Modes for the strain energy ½ ∫(dʳw/dξʳ)² dξ: r = 1 of torsion and extension, 2 of bending.

    They are those of the free beam among polynomials of degrees r to r + count − 1, which are
    orthogonal to rigid motion. From two bending modes, and from one of the others, statics under
    loads at the ends are exact, so chains of welded beams converge; natural modes would leave a
    share of the compliance out at each weld, however many beams there are. The lowest frequencies
    converge to the natural ones faster than any power of the count.
    """
    degrees = np.arange(order, order + count)
    series = np.zeros((order + count, count))
    # Shifted Legendre polynomials, of norm 1 / √(2k + 1), from the degree on whose derivative is
    # not zero: lower ones are rigid motion, to which all others are orthogonal.
    series[degrees, degrees - order] = np.sqrt(2 * degrees + 1)
    nodes, weights = quadrature(count)
    curved = np.array([derivative(series, xi, order) for xi in nodes])
    # In an orthonormal basis the mass matrix is the identity, and the eigenvalues are those of the
    # stiffness.
    squares, turned = np.linalg.eigh(np.einsum("i,ik,il->kl", weights, curved, curved))
    modes = series @ turned
    # Positive at the lower end.
    return FreeModes(squares, modes * np.sign(derivative(modes, 0.0)))


def derivative(series: np.ndarray, xi: Any, order: int = 0) -> Any:
    """dʳp/dξʳ of the polynomials at one ξ, (count,), or at those of a column, (points, count)."""
    return 2**order * legendre.legval(2 * xi - 1, legendre.legder(series, order), tensor=False)


def quadrature(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre on 0 to 1, exact for products of two modes and what else is in invariants."""
    nodes, weights = legendre.leggauss(count + 4)
    return (nodes + 1) / 2, weights / 2
