"""The KKT system of index one (chapter equation 39.2), solved by its Schur complement."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from ..common import precision
from .block_cholesky import Factor
from .dense import multiply
from .indexing import take
from .inverse_mass import InverseMass
from .pattern import Blocks, Pattern

# Two are the rule, a mass ratio of 1e8 takes a few. One that does not halve the residual is the
# last: what it leaves cannot be reached, or is rounding.
_SWEEPS = 20
# The second removes from the null space what rounding leaves there after the first.
_NULL_SWEEPS = 2

# The iteration carries multipliers, accelerations by rates, the residual, its size one sweep
# before, and the count of sweeps.
Carry = tuple[Blocks, Blocks, Blocks, Float[Array, " k"], Array | int]


class KKT(eqx.Module):
    """[[M, Cᵀ], [C, 0]] for one configuration, prepared once and solved for many right-hand sides.

    Rows are scaled first: B = D C has rows of unit length in the metric of M⁻¹, and μ = D⁻¹ λ are
    the multipliers that belong to it, since Cᵀ λ = Bᵀ μ. From M a + Bᵀ μ = f follows
    a = M⁻¹ (f − Bᵀ μ), and with B a = D γ the accelerations are eliminated:

        S μ = b,  S = B M⁻¹ Bᵀ,  b = B M⁻¹ f − D γ.

    S has a unit diagonal, so its condition depends neither on units nor on the masses of single
    bodies. It has a block for each joint and for each two joints on one body: M is block-diagonal
    by body and C sparse by joint.

    Redundant constraints make S singular. What is factored is S + ε I, and the proximal point
    method, started from μ = 0, solves S μ = b with it (Carpentier, Budhiraja, Mansard 2021,
    doi:10.15607/RSS.2021.XVII.017). A sweep minimises ½ μᵀ S μ − bᵀ μ + ½ ε |μ − μ_k|²:

        μ_{k+1} = μ_k + (S + ε I)⁻¹ r_k,  r_k = b − S μ_k,  r_{k+1} = ε (S + ε I)⁻¹ r_k.

    It multiplies the residual at an eigenvalue σ of S by ε/(σ + ε), so few sweeps are needed where
    σ ≫ ε. The residual at σ = 0, of a γ that contradicts itself, stays.

    **Arguments:**

    - `pattern`: where the blocks sit.
    - `mass`: (bodies, size, size), or (bodies, size) if all are diagonal.
    - `sides`: the blocks of C_q, (sides, height, size).
    - `inverse_mass`: M⁻¹, where it is known in closed form; else it is computed.
    """

    pattern: Pattern = eqx.field(static=True)
    mass: Float[Array, "bodies size *size"]
    sides: Float[Array, "sides height size"]
    inverse_mass: InverseMass  # T W Tᵀ
    scale: Float[Array, "nodes height"]  # D
    scaled: Float[Array, "sides height size"]  # B T
    factor: Factor | None  # of S + ε I; None without constraints

    @classmethod
    def dense(cls, jacobian: Float[Array, "m n"], mass: Float[Array, "n *n"]) -> "KKT":
        """All in one block: of a C_q and of M, or of its diagonal."""
        m, n = jacobian.shape
        return cls(Pattern.dense(n, m), mass[None], jacobian[None][: min(m, 1)])

    def __init__(
        self,
        pattern: Pattern,
        mass: Float[Array, "bodies size *size"],
        sides: Float[Array, "sides height size"],
        inverse_mass: InverseMass | None = None,
    ):
        self.pattern, self.mass, self.sides = pattern, mass, sides
        # Derivatives go through `solve` as a whole (implicit function), never through the factors.
        mass, sides, inverse_mass = jax.lax.stop_gradient((mass, sides, inverse_mass))
        inverse_mass = InverseMass.of(mass) if inverse_mass is None else inverse_mass
        self.inverse_mass = inverse_mass
        if pattern.m == 0:
            self.scale, self.scaled, self.factor = jnp.ones((0, 0), mass.dtype), sides, None
            return
        nodes, bodies, pairs = pattern.nodes, pattern.bodies, pattern.pairs
        # S = C_q M⁻¹ C_qᵀ. Rows get unit length in M⁻¹, so that metres and radians count alike.
        sides = inverse_mass.to_rates(sides, bodies)
        weighed = inverse_mass.weigh(sides, bodies)
        lengths = jnp.sum(weighed * sides, axis=2)
        lengths = jnp.sum(take(lengths, pattern.sides_of_nodes), axis=1)
        # A row of zeros asks for nothing, whatever its γ. Negative ones are of mass matrices that
        # are not positive, as of stiffened beams that bend too far.
        inverse = 1 / jnp.sqrt(jnp.where(lengths > 0, lengths, 1))
        self.scale = jnp.where(lengths == 0, 0, inverse)
        scale = take(self.scale, nodes)
        self.scaled = scale[:, :, None] * sides
        right = jnp.swapaxes(take(weighed, pairs.right), 1, 2)  # W Tᵀ Cᵀ
        products = multiply(take(self.scaled, pairs.left), right)
        products *= take(scale, pairs.right)[:, None]
        diagonal = jnp.sum(take(products, pairs.onto_nodes), axis=1)
        # The proximal term keeps S regular where joints repeat each other; sweeps take out what it
        # changes.
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
        if self.factor is None:
            return self.solve_mass(force), gamma
        return _solution(self, force, gamma)

    def pivots(self) -> Float[Array, " rows"]:
        """Return the pivots of the scaled Schur complement, one for each row and padded row.

        Where a row nearly depends on the others, the least pivot is about the square of the
        smallest singular value of the scaled C_q; where one repeats others, the proximal term.
        """
        assert self.factor is not None
        return self.factor.pivots()

    def lengths(self) -> Float[Array, " rows"]:
        """Return the squared length of each row of C_q in the metric of M⁻¹, as `pivots` order
        them; zero of a padded row.
        """
        scale: Float[Array, " rows"] = self.scale.ravel()
        return jnp.where(scale > 0, 1 / jnp.where(scale > 0, scale, 1) ** 2, 0)

    def solve_mass(self, force: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """M⁻¹ force."""
        free = jax.lax.custom_linear_solve(
            lambda a: _apply(self.mass, a),
            self.pattern.split(force),
            lambda _, force: self._by_rows(self.inverse_mass.apply, force),
            symmetric=True,
        )
        return self.pattern.join(free)

    def _multiply(
        self, mass: Any, sides: Any, a: Float[Array, "n k"], multipliers: Float[Array, "m k"]
    ) -> tuple[Float[Array, "n k"], Float[Array, "m k"]]:
        """(M a + Cᵀ λ, C a) with the blocks of an M and a C of this pattern, either one zero."""
        layout = self.pattern
        blocks, rows = layout.split(a), layout.split_rows(multipliers)
        forces, along = jnp.zeros_like(blocks), jnp.zeros_like(rows)
        if not isinstance(mass, SymbolicZero):
            forces += _apply(mass, blocks)
        if not isinstance(sides, SymbolicZero):
            forces += self.pattern.apply_jacobian_transpose(sides, rows)
            along = self.pattern.apply_jacobian(sides, blocks)
        return layout.join(forces), layout.join_rows(along)

    def _solve_linear(
        self, force: Float[Array, "n k"], gamma: Float[Array, "m k"]
    ) -> tuple[Float[Array, "n k"], Float[Array, "m k"]]:
        """`solve`, with a transpose."""
        size = self.pattern.n

        # One vector, not a pair: a pair of which only one half is differentiated has no transpose.
        def multiply_by(x: Array) -> Array:
            return jnp.concatenate(self._multiply(self.mass, self.sides, x[:size], x[size:]))

        def solve(_: Callable[[Array], Array], b: Array, project: bool = False) -> Array:
            return jnp.concatenate(self._solve(b[:size], b[size:], project))

        solution = jax.lax.custom_linear_solve(
            multiply_by,
            jnp.concatenate([force, gamma]),
            solve,
            # What a derivative asks for need not fit redundant rows: its best approximation does.
            transpose_solve=lambda _, b: solve(_, b, project=True),
        )
        return solution[:size], solution[size:]

    def _solve(
        self, force: Float[Array, "n k"], gamma: Float[Array, "m k"], project: bool = False
    ) -> tuple[Float[Array, "n k"], Float[Array, "m k"]]:
        factor, layout = self.factor, self.pattern
        assert factor is not None
        force, gamma = layout.split(force), layout.split_rows(gamma)
        gamma = self.scale[:, :, None] * gamma
        free = self._weighed(self._by_rows(self.inverse_mass.to_rates, force))
        rows = self.pattern.apply_jacobian(self.scaled, free)  # B M⁻¹ f
        # S λ = C_q M⁻¹ f − γ by Schur's complement, then a = M⁻¹ (f − C_qᵀ λ).
        target = rows - gamma
        if project:
            target = self.without_null(target)
        terms = _largest(rows) + _largest(gamma)

        def unfinished(carry: Carry) -> Array:
            multipliers, _, residual, before, count = carry
            # A residual is the difference of its terms: it cannot fall below their rounding.
            rounding = 4 * jnp.finfo(residual.dtype).eps * (terms + _largest(multipliers))
            size = _largest(residual)
            enough = precision.of(residual.dtype).residual * _largest(target) + rounding
            return jnp.any((size > enough) & (size < 0.5 * before)) & (count < _SWEEPS)

        def sweep(carry: Carry) -> Carry:
            multipliers, _, residual, _, count = carry
            # Iterative refinement, which is also the proximal point method on redundant rows: each
            # sweep shrinks the error there by ε / (σ + ε).
            multipliers += factor.solve(residual)
            reaction = self._weighed(
                self.pattern.apply_jacobian_transpose(self.scaled, multipliers)
            )
            remaining = target - self.pattern.apply_jacobian(self.scaled, reaction)
            return multipliers, free - reaction, remaining, _largest(residual), count + 1

        start: Carry = (jnp.zeros_like(target), free, target, jnp.full_like(terms, jnp.inf), 0)
        multipliers, a, *_ = jax.lax.while_loop(unfinished, sweep, start)
        multipliers = self.scale[:, :, None] * self.without_null(multipliers)
        a = self._by_rows(self.inverse_mass.from_rates, a)
        return layout.join(a), layout.join_rows(multipliers)

    def _weighed(self, x: Blocks) -> Blocks:
        """Rates of the momenta x."""
        return self._by_rows(self.inverse_mass.weigh, x)

    def _by_rows(self, function: Callable[[Blocks, np.ndarray], Blocks], x: Blocks) -> Blocks:
        """A function of rows, of columns of all bodies."""
        bodies = np.arange(len(x))
        return jnp.swapaxes(function(jnp.swapaxes(x, 1, 2), bodies), 1, 2)

    def without_null(self, x: Blocks) -> Blocks:
        """The part of x in the range of S, which is orthogonal to the null space of S.

        ε (S + ε I)⁻¹ multiplies the part of x at an eigenvalue σ of S by ε/(σ + ε): the part in the
        null space, σ = 0, stays as it is, and any other nearly vanishes. Applied twice, it leaves
        the null part and (ε/σ)² of the others, and that is subtracted from x. Of multipliers the
        difference is the shortest solution; of a right-hand side, its best approximation by one
        that has a solution.
        """
        epsilon, factor = precision.of(x.dtype).proximal, self.factor
        assert factor is not None

        # ε (S + ε)⁻¹ keeps what is in the null space of S, and takes ε/σ of all else.
        def damp(x: Blocks, _: None) -> tuple[Blocks, None]:
            return epsilon * factor.solve(x), None

        def sweep(x: Blocks, _: None) -> tuple[Blocks, None]:
            null, _ = jax.lax.scan(damp, x, None, length=2)
            return x - null, None

        return jax.lax.scan(sweep, x, None, length=_NULL_SWEEPS)[0]


@jax.custom_jvp
def _solution(
    kkt: KKT, force: Float[Array, "n k"], gamma: Float[Array, "m k"]
) -> tuple[Float[Array, "n k"], Float[Array, "m k"]]:
    """`KKT.solve` with constraints. JAX's own linear solve would trace its transpose each time."""
    return kkt._solve(force, gamma)


@functools.partial(_solution.defjvp, symbolic_zeros=True)
def _change_of_solution(primals: Any, tangents: Any) -> Any:
    """K dx = db − dK x, by the factors that solve K x = b."""
    kkt, change = primals[0], tangents[0]
    solution = _solution(*primals)
    # The equation differentiated: K dx = db − dK x.
    by_matrix = kkt._multiply(change.mass, change.sides, *solution)
    right = [
        -moved if isinstance(given, SymbolicZero) else given - moved
        for given, moved in zip(tangents[1:], by_matrix, strict=True)
    ]
    return solution, kkt._solve_linear(*right)


def _apply(mass: Float[Array, "count size *size"], x: Blocks) -> Blocks:
    return mass[:, :, None] * x if mass.ndim == 2 else multiply(mass, x)


def _largest(x: Blocks) -> Float[Array, " k"]:
    return jnp.max(jnp.abs(x), axis=(0, 1))
