"""Inverses of small matrices, by the several ways that depend on their size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import IDENTITY

from romjax.linalg.dense import invert, invert_any

# Of each way the least and the largest.
SIZES = (1, 2, 3, 6, 7, 24, 128, 130)
# [1] of the matrices; an inverse is as accurate as rounding times this.
CONDITION = 1e4


def definite(size: int, batch: tuple[int, ...] = ()) -> jax.Array:
    """Symmetric positive definite matrices of a known condition."""
    lot = np.random.default_rng(size)
    vectors, _ = np.linalg.qr(lot.normal(size=(*batch, size, size)))
    values = np.geomspace(1, CONDITION, size) if size > 1 else np.ones(1)
    return jnp.asarray(vectors * values @ np.swapaxes(vectors, -1, -2))


@pytest.mark.parametrize("size", SIZES)
def test_inverses_of_definite_matrices(size):
    """Of one and of several, and against the pivoted inverse, which takes any matrix.

    The terms of A A⁻¹ are as large as the condition.
    """
    tol = IDENTITY * CONDITION
    for batch in ((), (2, 3)):
        matrices = definite(size, batch)
        unit = matrices @ np.asarray(jax.jit(invert)(matrices))
        np.testing.assert_allclose(unit, np.broadcast_to(np.eye(size), unit.shape), atol=tol)
    one = definite(size)
    np.testing.assert_allclose(invert(one), invert_any(one), atol=tol)


def test_the_derivative_of_an_inverse():
    """dA⁻¹ = −A⁻¹ dA A⁻¹."""
    matrix, change = definite(20), definite(21)[1:, 1:]
    inverse, slope = jax.jvp(invert, (matrix,), (change,))
    inverse = np.asarray(inverse)
    expected = -inverse @ change @ inverse
    np.testing.assert_allclose(slope, expected, atol=IDENTITY * CONDITION * np.abs(expected).max())
