"""The extended system of index one (chapter equation 39.2), solved without ever factoring it."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import precision
from .block_cholesky import Factor
from .dense import invert, multiply, multiply_transposed
from .indexing import take
from .pattern import Pattern

# Two are the rule, a mass ratio of 1e8 takes a few; one that does not halve the rest is the last.
_SWEEPS = 20
# The second removes what rounding leaves of the first.
_NULL_SWEEPS = 2

Blocks = Float[Array, "_ _ _"]
# Of the iteration: multipliers, accelerations, what is left, its size before, the count of sweeps.
Carry = tuple[Blocks, Blocks, Blocks, Float[Array, " k"], Array | int]


class KKT(eqx.Module):
    """[[M, Cᵀ], [C, 0]] for one configuration, prepared once and solved for many right-hand sides.

    M is block-diagonal by body and C sparse by joint, and so is the Schur complement S = B M⁻¹ Bᵀ.
    B = D C has unit rows in the metric of M⁻¹, so the condition of S knows neither units nor the
    masses of single bodies.

    **Arguments:**

    - `pattern`: where the blocks sit.
    - `mass`: (bodies, size, size), or (bodies, size) if all are diagonal.
    - `sides`: the blocks of C_q, (sides, height, size).
    """

    pattern: Pattern = eqx.field(static=True)
    mass: Float[Array, "bodies size *size"]
    sides: Float[Array, "sides height size"]
    inverse_mass: Float[Array, "bodies size *size"]
    scale: Float[Array, "nodes height"]  # D
    scaled: Float[Array, "sides height size"]  # B
    factor: Factor | None  # of S + ε I; None without constraints

    def __init__(
        self,
        pattern: Pattern,
        mass: Float[Array, "bodies size *size"],
        sides: Float[Array, "sides height size"],
    ):
        self.pattern, self.mass, self.sides = pattern, mass, sides
        # Derivatives go through `solve` as a whole (implicit function), never through the factors.
        mass, sides = jax.lax.stop_gradient((mass, sides))
        self.inverse_mass = 1 / mass if mass.ndim == 2 else invert(mass)
        if pattern.m == 0:
            self.scale, self.scaled, self.factor = jnp.ones((0, 0), mass.dtype), sides, None
            return
        nodes, bodies, pairs = pattern.nodes, pattern.bodies, pattern.pairs
        free = _apply(take(self.inverse_mass, bodies), jnp.swapaxes(sides, 1, 2))  # M⁻¹ Cᵀ
        lengths = jnp.sum(jnp.swapaxes(free, 1, 2) * sides, axis=2)
        lengths = jnp.sum(take(lengths, pattern.sides_of_nodes), axis=1)
        self.scale = 1 / jnp.sqrt(jnp.where(lengths > 0, lengths, 1))
        scale = take(self.scale, nodes)
        self.scaled = scale[:, :, None] * sides
        products = multiply(take(self.scaled, pairs.left), take(free, pairs.right))
        products *= take(scale, pairs.right)[:, None]
        diagonal = jnp.sum(take(products, pairs.onto_nodes), axis=1)
        unit = precision.of(mass.dtype).proximal * jnp.eye(diagonal.shape[1], dtype=mass.dtype)
        couplings = jnp.sum(take(products, pairs.onto_edges), axis=1)
        self.factor = Factor(diagonal + unit[None], couplings, pattern.edges)

    def solve(
        self, force: Float[Array, "n *k"], gamma: Float[Array, "m *k"]
    ) -> tuple[Float[Array, "n *k"], Float[Array, "m *k"]]:
        """(a, λ) with M a + Cᵀ λ = force and C a = gamma.

        Where λ is not unique, it is the shortest one, in rows of unit length. The derivative is
        that of the solution, with the redundancy as it is.
        """
        if force.ndim == 1:
            a, multipliers = self.solve(force[:, None], gamma[:, None])
            return a[:, 0], multipliers[:, 0]
        layout = self.pattern
        if self.factor is None:
            return self.solve_mass(force), gamma
        size = layout.n

        # One vector, not a pair: a pair of which only one half is differentiated has no transpose.
        def matvec(x: Array) -> Array:
            a, multipliers = layout.split(x[:size]), layout.split_rows(x[size:])
            inertia = _apply(self.mass, a) + self._apply_jacobian_transpose(self.sides, multipliers)
            bend = self._apply_jacobian(self.sides, a)
            return jnp.concatenate([layout.join(inertia), layout.join_rows(bend)])

        def solve(_: Callable[[Array], Array], b: Array, project: bool = False) -> Array:
            return self._solve(layout.split(b[:size]), layout.split_rows(b[size:]), project)

        found = jax.lax.custom_linear_solve(
            matvec,
            jnp.concatenate([force, gamma]),
            solve,
            # What a derivative asks for need not fit redundant rows: its best approximation does.
            transpose_solve=lambda _, b: solve(_, b, project=True),
        )
        return found[:size], found[size:]

    def solve_mass(self, force: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """M⁻¹ force."""
        free = jax.lax.custom_linear_solve(
            lambda a: _apply(self.mass, a),
            self.pattern.split(force),
            lambda _, force: _apply(self.inverse_mass, force),
            symmetric=True,
        )
        return self.pattern.join(free)

    def _solve(self, force: Blocks, gamma: Blocks, project: bool) -> Float[Array, "whole k"]:
        factor = self.factor
        assert factor is not None
        free, gamma = _apply(self.inverse_mass, force), self.scale[:, :, None] * gamma
        bend = self._apply_jacobian(self.scaled, free)
        target = bend - gamma
        if project:
            target = self._without_null(target)
        terms = _largest(bend) + _largest(gamma)

        def unfinished(carry: Carry) -> Array:
            multipliers, _, rest, before, count = carry
            # A residual is the difference of its terms: it cannot fall below their rounding.
            rounding = 4 * jnp.finfo(rest.dtype).eps * (terms + _largest(multipliers))
            left = _largest(rest)
            enough = precision.of(rest.dtype).residual * _largest(target) + rounding
            return jnp.any((left > enough) & (left < 0.5 * before)) & (count < _SWEEPS)

        def sweep(carry: Carry) -> Carry:
            multipliers, _, rest, _, count = carry
            multipliers += factor.solve(rest)
            push = _apply(
                self.inverse_mass, self._apply_jacobian_transpose(self.scaled, multipliers)
            )
            again = target - self._apply_jacobian(self.scaled, push)
            return multipliers, free - push, again, _largest(rest), count + 1

        start: Carry = (jnp.zeros_like(target), free, target, jnp.full_like(terms, jnp.inf), 0)
        multipliers, a, *_ = jax.lax.while_loop(unfinished, sweep, start)
        multipliers = self.scale[:, :, None] * self._without_null(multipliers)
        return jnp.concatenate([self.pattern.join(a), self.pattern.join_rows(multipliers)])

    def _without_null(self, x: Blocks) -> Blocks:
        """The part of x in the range of S.

        ε (S + ε I)⁻¹ keeps the rest of x, and ε/σ of its part at a singular value σ; twice, less.
        """
        epsilon, factor = precision.of(x.dtype).proximal, self.factor
        assert factor is not None

        def damp(x: Blocks, _: None) -> tuple[Blocks, None]:
            return epsilon * factor.solve(x), None

        def sweep(x: Blocks, _: None) -> tuple[Blocks, None]:
            rest, _ = jax.lax.scan(damp, x, None, length=2)
            return x - rest, None

        return jax.lax.scan(sweep, x, None, length=_NULL_SWEEPS)[0]

    def _apply_jacobian(self, sides: Float[Array, "sides height size"], a: Blocks) -> Blocks:
        """C a."""
        each = multiply(sides, take(a, self.pattern.bodies))
        return jnp.sum(take(each, self.pattern.sides_of_nodes), axis=1)

    def _apply_jacobian_transpose(
        self, sides: Float[Array, "sides height size"], multipliers: Blocks
    ) -> Blocks:
        """Cᵀ λ."""
        each = multiply_transposed(sides, take(multipliers, self.pattern.nodes))
        return jnp.sum(take(each, self.pattern.sides_of_bodies), axis=1)


def _apply(mass: Float[Array, "count size *size"], x: Blocks) -> Blocks:
    return mass[:, :, None] * x if mass.ndim == 2 else multiply(mass, x)


def _largest(x: Blocks) -> Float[Array, " k"]:
    return jnp.max(jnp.abs(x), axis=(0, 1))
