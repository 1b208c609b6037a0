"""Inverses of constant matrices, by sums along branches where these link unknowns like a forest."""

import abc
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import multiply
from .indexing import Index, take

# Entries below this share of the largest are what rounding leaves of terms that cancel, and link no
# unknowns.
_ZERO = 1e-12


class AbstractInverse(eqx.Module):
    """D⁻¹ of a regular matrix D, prepared once."""

    @abc.abstractmethod
    def apply(self, right: Float[Array, "m *k"]) -> Float[Array, "m *k"]:
        """D⁻¹ b, for one or several b."""


class DenseInverse(AbstractInverse):
    """D⁻¹ as a matrix: m² products."""

    matrix: Float[Array, "m m"]

    def apply(self, right: Float[Array, "m *k"]) -> Float[Array, "m *k"]:
        return multiply(self.matrix, right)


@dataclasses.dataclass(frozen=True)
class Forest:
    """Unknowns each of which its own row of D links with one other at most, its parent.

    - `rows` (1, m): the row of each unknown.
    - `ancestors` (levels, m): its ancestor 1, 2, 4 … links before, m where there is none.
    """

    rows: Index
    ancestors: Index

    @classmethod
    def of(cls, matrix: np.ndarray) -> "Forest | None":
        """Return the forest that the nonzero entries of a matrix (m, m) make, if they make one."""
        size = len(matrix)
        links = np.abs(matrix) > _ZERO * np.max(np.abs(matrix), initial=0)
        ends = [np.flatnonzero(row) for row in links]
        rows, parents = np.full(size, size), np.full(size + 1, size)
        # The search goes outwards from the unknowns that have a row of their own.
        reached = [(i, int(own[0]), size) for i, own in enumerate(ends) if len(own) == 1]
        while reached:
            row, unknown, parent = reached.pop()
            # A second row for one unknown closes a loop, which no forest has.
            if rows[unknown] < size:
                return None
            rows[unknown], parents[unknown] = row, parent
            for other in np.flatnonzero(links[:, unknown]):
                if other != row and len(ends[other]) == 2:
                    child = int(ends[other][ends[other] != unknown][0])
                    reached.append((int(other), child, unknown))
        if np.any(rows == size):
            return None
        ancestors = list[list[int]]()
        while np.any(parents < size):
            # The parent of a parent is twice as far away; m, which stands for none, is its own.
            ancestors.append(parents[:-1].tolist())
            parents = parents[parents]
        return cls(Index.of([rows.tolist()]), Index.of(ancestors))


class Branches(AbstractInverse):
    """D⁻¹ of a forest: sums along its branches.

    The row of an unknown gives x_i = s_i b_i + f_i x_p of its parent p. Doubling solves all of them
    in log₂ of the depth steps, x_i ← x_i + F_i x at the ancestor 1, 2, 4 … links before, with the
    product F of the factors on the way (Hillis and Steele, "Data parallel algorithms", CACM 29,
    1986, doi:10.1145/7902.7903).
    """

    scale: Float[Array, " m"]  # s
    factors: Float[Array, "levels m"]  # F; zero where there is no ancestor
    forest: Forest = eqx.field(static=True)

    @classmethod
    def of(cls, matrix: Float[Array, "m m"], forest: Forest) -> "Branches":
        """Factor a matrix D whose pattern is that of the forest."""
        rows, unknowns = forest.rows.array[0], np.arange(len(matrix))
        scale, levels = 1 / matrix[rows, unknowns], forest.ancestors.array
        factors = list[Array]()
        for parents in levels[:1]:
            exists = parents < len(matrix)
            linked = matrix[rows, np.where(exists, parents, 0)]
            factors.append(jnp.where(exists, -scale * linked, 0))
        # The factor over twice as many links is the product of those over both halves.
        for before in levels[:-1]:
            factors.append(factors[-1] * take(factors[-1], before))
        none = jnp.zeros((0, len(matrix)), matrix.dtype)
        return cls(scale, jnp.stack(factors) if factors else none, forest)

    def apply(self, right: Float[Array, "m *k"]) -> Float[Array, "m *k"]:
        def along(numbers: Array) -> Array:
            return numbers.reshape(numbers.shape + (1,) * (right.ndim - 1))

        def add(x: Array, level: tuple[Array, Array]) -> tuple[Array, None]:
            ancestors, factor = level
            return x + along(factor) * x[ancestors], None

        x: Array = along(self.scale) * self.forest.rows.take(right)[0]
        # A loop: XLA would compute what it fuses into a gather again for each entry.
        table = self.forest.ancestors.array
        before = jnp.asarray(np.where(table < len(x), table, 0))
        return jax.lax.scan(add, x, (before, self.factors))[0]


def inverted(matrix: Float[Array, "m m"], forest: Forest | None) -> AbstractInverse:
    """The inverse of a matrix, along the branches of a forest that has its pattern."""
    if forest is None:
        return DenseInverse(jnp.linalg.inv(matrix))
    return Branches.of(matrix, forest)
