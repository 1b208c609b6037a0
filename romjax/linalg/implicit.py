"""The KKT system of an implicit step, in the second-order form of the equations of motion."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import precision
from .block_lu import BlockLU
from .dense import multiply, multiply_transposed
from .indexing import spread, sum_onto, take
from .kkt import KKT
from .ordering import Edge
from .pattern import Pattern
from .supernodes import supernodes

# Refinement takes so many sweeps at most, as that of `KKT`.
_SWEEPS = 20

Blocks = Float[Array, "_ _ _"]


class Columns(NamedTuple):
    """The columns of a KKT matrix that belong to the coordinates, in blocks.

    - `own` (bodies, size, size): of bodies by themselves; `coupled` (pairs, size, size): of the
      first body of each pair by coordinates of the second.
    - `sides` (sides, height, size): of the constraints, as C_q.
    """

    own: Blocks
    coupled: Blocks
    sides: Blocks


class Slopes(eqx.Module):
    """The derivatives of the residuals M a + C_qᵀ λ − Q and C_q a − γ, with a and λ held."""

    by_position: Columns  # K and G_q
    by_velocity: Columns  # D and G_v
    pairs: tuple[Edge, ...] = eqx.field(static=True)  # bodies that are coupled


class ImplicitKKT(eqx.Module):
    """[[A, Cᵀ], [C′, 0]] of a step s, with A = M + s D + s² K and C′ = C + s G_v + s² G_q.

    From W w = b + s ∂a/∂q c with W = 1/s − ∂a/∂v − s ∂a/∂q follows, since the derivatives of a
    solve the KKT system of M and C with the right-hand sides −K and −G_q, −D and −G_v, that

        A w + Cᵀ ν = s (M b − s K c),  C′ w = s (C b − s G_q c).

    It has a block for each body and each joint, and is eliminated along the tree that they make,
    once for all stages: nothing is solved for 2n right-hand sides.

    Rows are scaled as those of `KKT`. Where they are `redundant`, a proximal term −ε stands in
    place of the zero, and sweeps take its effect out again. What C′ asks for along a null direction
    of Cᵀ no ν can give, and w does not follow it, as accelerations do not in `KKT`.
    """

    kkt: KKT
    slopes: Slopes
    step: Float[Array, ""]
    columns: Columns  # A and C′, scaled
    across: Blocks  # C, scaled
    factor: BlockLU
    redundant: bool = eqx.field(static=True)

    def __init__(self, kkt: KKT, slopes: Slopes, step: Float[Array, ""], redundant: bool):
        self.kkt, self.slopes, self.step, self.redundant = kkt, slopes, step, redundant
        left = jax.tree.map(
            lambda mass, by_v, by_q: mass + step * (by_v + step * by_q),
            self._mass,
            slopes.by_velocity,
            slopes.by_position,
        )
        scale = take(kkt.scale, self.pattern.nodes)[:, :, None] if self.pattern.m else 1.0
        self.columns = left._replace(sides=scale * left.sides)
        self.across = scale * kkt.sides
        # Derivatives go through `stage` as a whole (implicit function), never through the factors.
        self.factor = jax.lax.stop_gradient(self._factor())

    @property
    def pattern(self) -> Pattern:
        """The places of the blocks."""
        return self.kkt.pattern

    def stage(self, b: Float[Array, " n"], c: Float[Array, " n"]) -> Float[Array, " n"]:
        """The solution w of W w = b + s ∂a/∂q c."""
        # (M b − s K c, C b − s G_q c), and s times it below.
        right = self._apply(self._mass, b[:, None])
        right -= self.step * self._apply(self.slopes.by_position, c[:, None])
        if self.pattern.m:
            n = self.pattern.n
            rows = self.kkt.scale[:, :, None] * self.pattern.split_rows(right[n:])
            right = jnp.concatenate([right[:n], self.pattern.join_rows(rows)])
        return _solution(self, self.step * right)[: self.pattern.n, 0]

    @property
    def _mass(self) -> Columns:
        """The columns of M and C."""
        kkt = self.kkt
        mass = jax.vmap(jnp.diag)(kkt.mass) if kkt.mass.ndim == 2 else kkt.mass
        none = jnp.zeros_like(self.slopes.by_position.coupled)
        return Columns(mass, none, kkt.sides)

    def _factor(self) -> BlockLU:
        layout, columns = supernodes(self.pattern, self.slopes.pairs), self.columns
        (count, width), edges = layout.unknowns.shape, len(layout.edges)
        dtype, m = columns.own.dtype, self.pattern.m
        # Rounding alone lets a lone singular position have a finite solution.
        epsilon = precision.of(dtype).proximal if self.redundant else jnp.finfo(dtype).eps
        places = _places(self.pattern, self.slopes.pairs)
        constant = jnp.full(m, -epsilon, dtype), jnp.ones(len(places[-1]), dtype)
        blocks = spread(
            [*columns, self.across, *constant], list(places), (count + 2 * edges, width, width)
        )
        couplings = blocks[count:].reshape(edges, 2, width, width)
        return BlockLU(blocks[:count], couplings, layout.edges, layout.after)

    def _solve(self, right: Float[Array, "size k"], transposed: bool) -> Float[Array, "size k"]:
        layout = supernodes(self.pattern, self.slopes.pairs)
        solve = self.factor.solve_transposed if transposed else self.factor.solve

        def once(right: Array) -> Array:
            x = solve(take(right, layout.unknowns))
            return x.reshape(-1, right.shape[1])[layout.places]

        if not self.redundant:
            return once(right)
        n = self.pattern.n

        # Accelerations and multipliers have units of their own, so that each part is judged by
        # itself.
        def sizes(x: Array) -> Array:
            return jnp.stack([jnp.max(jnp.abs(part), axis=0) for part in (x[:n], x[n:])])

        enough = precision.of(right.dtype).residual * sizes(right)

        def unfinished(carry: Any) -> Array:
            _, left, before, count = carry
            size = sizes(left)
            more: Array = jnp.any((size > enough) & (size < 0.5 * before)) & (count < _SWEEPS)
            return more

        def sweep(carry: Any) -> Any:
            x, left, _, count = carry
            x += once(left)
            return x, right - self._multiply(self, x, transposed), sizes(left), count + 1

        start = (jnp.zeros_like(right), right, jnp.full_like(enough, jnp.inf), 0)
        solution: Array = jax.lax.while_loop(unfinished, sweep, start)[0]
        return solution

    def _multiply(
        self, blocks: Any, x: Float[Array, "size k"], transposed: bool = False
    ) -> Float[Array, "size k"]:
        """The product with the matrix of the `columns` and `across` of some `blocks`, or with its
        transpose.
        """
        pattern, columns, across = self.pattern, blocks.columns, blocks.across
        if transposed:
            own, coupled = (jnp.swapaxes(b, 1, 2) for b in columns[:2])
            columns, across = Columns(own, coupled, across), columns.sides
        product = self._apply(columns, x[: pattern.n], transposed)
        if not pattern.m:
            return product
        rows = take(pattern.split_rows(x[pattern.n :]), pattern.nodes)
        each = take(multiply_transposed(across, rows), pattern.sides_of_bodies)
        force = pattern.join(jnp.sum(each, axis=1))
        return product + jnp.pad(force, ((0, pattern.m), (0, 0)))

    def _apply(
        self, columns: Columns, x: Float[Array, "n k"], transposed: bool = False
    ) -> Float[Array, "size k"]:
        """The product with some columns; `transposed`: the pairs are those of the transpose."""
        pattern, pairs = self.pattern, self.slopes.pairs
        motion = pattern.split(x)
        force = multiply(columns.own, motion)
        if pairs:
            first, second = np.array(pairs).T[:: -1 if transposed else 1]
            pulled = multiply(columns.coupled, take(motion, second))
            force += sum_onto(pulled, first, len(force))
        if not pattern.m:
            return pattern.join(force)
        each = take(multiply(columns.sides, take(motion, pattern.bodies)), pattern.sides_of_nodes)
        return jnp.concatenate([pattern.join(force), pattern.join_rows(jnp.sum(each, axis=1))])


@jax.custom_jvp
def _solution(system: ImplicitKKT, right: Float[Array, "size k"]) -> Float[Array, "size k"]:
    return system._solve(right, transposed=False)


@_solution.defjvp
def _change_of_solution(primals: Any, tangents: Any) -> Any:
    """J dx = db − dJ x, by the factors that solve J x = b."""
    (system, right), (change, given) = primals, tangents
    solution = held = _solution(system, right)
    if system.redundant:
        # Forces do not tell how repeated rows share a multiplier. dJ takes the shares of `KKT`, the
        # shortest ones, from which those of these factors may differ.
        n, pattern = system.pattern.n, system.pattern
        rows = system.kkt.without_null(pattern.split_rows(solution[n:]))
        held = jnp.concatenate([solution[:n], pattern.join_rows(rows)])
    moved: Array = jax.lax.custom_linear_solve(
        lambda x: system._multiply(system, x),
        given - system._multiply(change, held),
        lambda _, right: system._solve(right, transposed=False),
        lambda _, right: system._solve(right, transposed=True),
    )
    return solution, moved


@functools.lru_cache(maxsize=64)
def _places(pattern: Pattern, pairs: tuple[Edge, ...]) -> tuple[np.ndarray, ...]:
    """Return the places of the entries of the blocks, of the proximal term and of padding among
    those of the blocks of the supernodes; −1 where there is none.
    """
    layout, none = supernodes(pattern, pairs), pattern.n + pattern.m
    count, width = layout.unknowns.shape
    # Blocks on the diagonal come first, then for each edge the one above it and the one below it.
    number = np.zeros((count, count), int)
    number[np.arange(count), np.arange(count)] = np.arange(count)
    for at, (i, j) in enumerate(layout.edges):
        number[i, j], number[j, i] = count + 2 * at, count + 2 * at + 1
    block, place = (np.append(x, 0) for x in np.divmod(layout.places, width))

    def flat(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        at = (number[block[rows], block[columns]] * width + place[rows]) * width + place[columns]
        return np.where((rows < none) & (columns < none), at, -1)

    motion, rows = (x.array.astype(int) for x in (pattern.coordinates, pattern.rows))
    motion = np.where(motion < pattern.n, motion, none)
    rows = np.where(rows < pattern.m, pattern.n + rows, none)
    first, second = np.array(pairs, int).reshape(-1, 2).T
    # C′ has its rows at the constraints and its columns at the coordinates, Cᵀ the other way round.
    held, moved = rows[pattern.nodes][:, :, None], motion[pattern.bodies][:, None]
    multipliers = np.arange(pattern.n, none)
    free = np.argwhere(layout.unknowns == none)
    return (
        flat(motion[:, :, None], motion[:, None]),
        flat(motion[first][:, :, None], motion[second][:, None]),
        flat(held, moved),
        flat(moved, held),
        flat(multipliers, multipliers),
        (free[:, 0] * width + free[:, 1]) * width + free[:, 1],
    )
