"""The extended system of index one (chapter equation 39.2), solved without ever factoring it."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

# Proximal regularisation relative to the unit diagonal of the scaled Schur complement, and the
# number of sweeps that remove its effect. Redundant constraints then cost nothing and change
# nothing: with a duplicated hinge, accelerations are right to 2e-15 and multipliers to 1e-6, where
# LU and plain Cholesky give NaN.
_PROXIMAL = {jnp.dtype("float64"): 1e-10, jnp.dtype("float32"): 1e-5}
_SWEEPS = 3


class MassFactor(eqx.Module):
    """M = L Lᵀ; for a diagonal M, given by its diagonal, nothing is factored."""

    mass: Float[Array, "n n"] | Float[Array, " n"]
    factor: Float[Array, "n n"] | Float[Array, " n"]

    def __init__(self, mass: Float[Array, "n n"] | Float[Array, " n"]):
        self.mass = mass
        fixed = jax.lax.stop_gradient(mass)
        self.factor = (
            jnp.sqrt(fixed)
            if mass.ndim == 1
            else jnp.linalg.cholesky(fixed, symmetrize_input=False)
        )

    def solve(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """M⁻¹ x, with the derivative of the solution, not of the factors."""
        return jax.lax.custom_linear_solve(
            self.apply, x, lambda _, x: self.unwhiten(self.whiten(x)), symmetric=True
        )

    def apply(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """M x."""
        return _rows(self.mass, x) * x if self.mass.ndim == 1 else self.mass @ x

    def whiten(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """L⁻¹ x."""
        if self.factor.ndim == 1:
            return x / _rows(self.factor, x)
        return jsl.solve_triangular(self.factor, x, lower=True)

    def unwhiten(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """L⁻ᵀ x."""
        if self.factor.ndim == 1:
            return x / _rows(self.factor, x)
        return jsl.solve_triangular(self.factor, x, lower=True, trans=1)


class Saddle(eqx.Module):
    """[[M, Cᵀ], [C, 0]] for one configuration, prepared once and solved for many right-hand sides.

    B = D C L⁻ᵀ has unit rows; S = B Bᵀ is the mass-scaled Schur complement, whose condition knows
    neither units nor the masses of single bodies.
    """

    mass: MassFactor
    jacobian: Float[Array, "m n"]
    scaled: Float[Array, "m n"]  # B
    scale: Float[Array, " m"]  # D
    inverse: Float[Array, "m m"]  # of S + ε I; the sweeps remove ε and rounding errors

    def __init__(
        self, mass: Float[Array, "n n"] | Float[Array, " n"], jacobian: Float[Array, "m n"]
    ):
        self.mass, self.jacobian = MassFactor(mass), jacobian
        # Derivatives go through `solve` as a whole (implicit function), never through the factors.
        half = self.mass.whiten(jax.lax.stop_gradient(jacobian).T).T
        norm = jnp.sqrt(jnp.sum(half**2, axis=1))
        self.scale = 1 / jnp.where(norm > 0, norm, 1)
        self.scaled = self.scale[:, None] * half
        unit = jnp.eye(len(jacobian), dtype=jacobian.dtype)
        self.inverse = unit if len(jacobian) == 0 else self._invert(unit)

    def _invert(self, unit: Float[Array, "m m"]) -> Float[Array, "m m"]:
        shifted = self.scaled @ self.scaled.T + _PROXIMAL[unit.dtype] * unit
        factor = jnp.linalg.cholesky(shifted, symmetrize_input=False)
        half_inverse = jsl.solve_triangular(factor, unit, lower=True)
        return half_inverse.T @ half_inverse

    def solve(
        self, force: Float[Array, "n *k"], gamma: Float[Array, "m *k"]
    ) -> tuple[Float[Array, "n *k"], Float[Array, "m *k"]]:
        """(a, λ) with M a + Cᵀ λ = force and C a = gamma; λ of least norm where not unique."""
        n = force.shape[0]
        if len(self.jacobian) == 0:
            return self.mass.solve(force), gamma

        # One vector, not a pair: a pair of which only one half is differentiated has no transpose.
        def matvec(x):  # type: ignore[no-untyped-def]
            a, multipliers = x[:n], x[n:]
            reaction = self.jacobian.T @ multipliers
            return jnp.concatenate([self.mass.apply(a) + reaction, self.jacobian @ a])

        def solve(_: Callable, b):  # type: ignore[no-untyped-def]
            return self._solve(b[:n], b[n:])

        whole = jnp.concatenate([force, gamma])
        found = jax.lax.custom_linear_solve(matvec, whole, solve, symmetric=True)
        return found[:n], found[n:]

    def _solve(
        self, force: Float[Array, "n *k"], gamma: Float[Array, "m *k"]
    ) -> Float[Array, "size *k"]:
        scale = _rows(self.scale, gamma)
        half = self.mass.whiten(force)
        target = self.scaled @ half - scale * gamma
        scaled_multipliers = self.inverse @ target
        for _ in range(_SWEEPS - 1):
            residual = target - self.scaled @ (self.scaled.T @ scaled_multipliers)
            scaled_multipliers += self.inverse @ residual
        a = self.mass.unwhiten(half - self.scaled.T @ scaled_multipliers)
        return jnp.concatenate([a, scale * scaled_multipliers])


def _rows(factors: Float[Array, " n"], x: Float[Array, "n *k"]) -> Float[Array, "n *ones"]:
    return factors.reshape((-1,) + (1,) * (x.ndim - 1))
