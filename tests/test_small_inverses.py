"""Inverses of small matrices, by the several ways that depend on their size."""

import jax
import numpy as np
import pytest
from programs import kept
from tolerances import IDENTITY

from romjax.linalg.dense import invert, invert_any, solve_by_similar

# Of each way the least and the largest.
SIZES = (1, 2, 3, 6, 7, 24, 128, 130, 192)
# [1] of the matrices; an inverse is as accurate as rounding times this.
CONDITION = 1e4


def definite(size: int, batch: tuple[int, ...] = ()) -> np.ndarray:
    """Symmetric positive definite matrices of a known condition."""
    lot = np.random.default_rng(size)
    vectors, _ = np.linalg.qr(lot.normal(size=(*batch, size, size)))
    values = np.geomspace(1, CONDITION, size) if size > 1 else np.ones(1)
    return vectors * values @ np.swapaxes(vectors, -1, -2)


@kept
def inverses(one, several):
    return invert(one), invert(several), invert_any(one)


@pytest.mark.parametrize("size", SIZES)
def test_inverses_of_definite_matrices(size):
    """Of one and of several, and against the pivoted inverse, which takes any matrix.

    The terms of A A⁻¹ are as large as the condition.
    """
    tol = IDENTITY * CONDITION
    matrices = definite(size), definite(size, (2, 3) if size < 100 else (2,))
    *found, pivoted = map(np.asarray, inverses(*matrices))
    for matrix, inverse in zip(matrices, found, strict=True):
        unit = matrix @ inverse
        np.testing.assert_allclose(unit, np.broadcast_to(np.eye(size), unit.shape), atol=tol)
    np.testing.assert_allclose(found[0], pivoted, atol=tol)


@kept
def slope(matrix, change):
    return jax.jvp(invert, (matrix,), (change,))


def test_the_derivative_of_an_inverse():
    """dA⁻¹ = −A⁻¹ dA A⁻¹."""
    matrix, change = definite(20), definite(21)[1:, 1:]
    inverse, found = map(np.asarray, slope(matrix, change))
    expected = -inverse @ change @ inverse
    np.testing.assert_allclose(found, expected, atol=IDENTITY * CONDITION * np.abs(expected).max())


@kept
def refined(matrix, inverse, right, change):
    return jax.jvp(lambda a: solve_by_similar(a, inverse, right), (matrix,), (change,))


def test_solutions_by_the_inverse_of_a_similar_matrix():
    """And their derivative, −A⁻¹ dA x."""
    matrix, change = definite(20), definite(21)[1:, 1:]
    nearby = matrix + 0.2 * matrix @ change / np.linalg.norm(change, 2)
    right = np.random.default_rng(0).normal(size=(20, 2))
    x, along = map(np.asarray, refined(matrix, np.linalg.inv(nearby), right, change))
    expected = np.linalg.solve(matrix, right)
    tol = IDENTITY * CONDITION
    np.testing.assert_allclose(x, expected, atol=tol * np.abs(expected).max())
    slope = -np.linalg.solve(matrix, change @ expected)
    np.testing.assert_allclose(along, slope, atol=tol * np.abs(slope).max())
