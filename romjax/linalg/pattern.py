"""The static pattern of M and C_q, by the bodies that each joint connects."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import multiply, multiply_transposed
from .indexing import Index, spread, take
from .ordering import Edge

Blocks = Float[Array, "_ _ _"]


class Pairs(NamedTuple):
    """Sides on the same body: their products make the Schur complement C_q M⁻¹ C_qᵀ."""

    left: np.ndarray  # sides
    right: np.ndarray
    onto_nodes: np.ndarray  # (nodes, most) which pairs each diagonal block sums
    onto_edges: np.ndarray  # (edges, most)


@dataclasses.dataclass(frozen=True)
class Pattern:
    """Bodies, nodes and sides.

    A node is a set of constraints between the same bodies; a side is what a node does to one
    body: a block of C_q. All blocks have the same shape, padded with zeros; the indices n
    and m stand for the padding.
    """

    n: int
    m: int
    coordinates: Index  # of each body, (bodies, size)
    rows: Index  # of each node, (nodes, height)
    sides: Index  # node and body of each side, (sides, 2)

    @classmethod
    def dense(cls, n: int, m: int) -> "Pattern":
        """All in one block: a single body, a single node."""
        sides = [(0, 0)] if m else []
        return cls(n, m, Index.of([range(n)]), Index.of([range(m)]), Index.of(sides))

    @classmethod
    def of(
        cls,
        bodies: Sequence[Sequence[int]],
        joints: Sequence[tuple[Sequence[int], Sequence[int]]],
    ) -> "Pattern":
        """Make the pattern from each body's coordinates and each joint's bodies and constraints.

        Joints between the same bodies share a node as long as they fit into the tallest one.
        """
        n = sum(map(len, bodies))
        m = sum(len(rows) for _, rows in joints)
        height = max((len(rows) for _, rows in joints), default=0)
        nodes: list[tuple[list[int], list[int]]] = []
        for held, rows in joints:
            involved = sorted(held)
            for connected, node_rows in nodes:
                # Rows of one node have the same pattern, so that they share its blocks up to the
                # height that all blocks are padded to.
                if connected == involved and len(node_rows) + len(rows) <= height:
                    node_rows += rows
                    break
            else:
                nodes.append((involved, list(rows)))
        size = max(map(len, bodies))
        return cls(
            n,
            m,
            Index.of([[*columns, *[n] * (size - len(columns))] for columns in bodies]),
            Index.of([[*rows, *[m] * (height - len(rows))] for _, rows in nodes]),
            Index.of([(j, body) for j, (involved, _) in enumerate(nodes) for body in involved]),
        )

    def flat_indices(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the indices of entries of C_q among those of all blocks; −1 where there is none.

        For constraints `rows` (joints, height) and coordinates `columns` (2, joints, size) of the
        bodies on both sides, n where there is none.
        """
        position_of_row = {int(row): at for at, row in np.ndenumerate(self.rows.array)}
        side_of = {tuple(map(int, ends)): k for k, ends in enumerate(self.sides.array)}
        height, size = self.rows.width, self.coordinates.width
        indices = np.full((*columns.shape[:2], rows.shape[1], columns.shape[2]), -1)
        held = self.bodies_at(columns[:, :, 0])
        for side, joint in np.ndindex(columns.shape[:2]):
            body = int(held[side, joint])
            if body < 0:  # the ground
                continue
            exists = columns[side, joint] < self.n
            for r, row in enumerate(rows[joint]):
                node, position = position_of_row[int(row)]
                start = (side_of[node, body] * height + position) * size
                entries = start + np.arange(columns.shape[2])
                indices[side, joint, r] = np.where(exists, entries, -1)
        return indices

    def bodies_at(self, coordinates: np.ndarray) -> np.ndarray:
        """Return the bodies whose first coordinates are given; −1 where there is none."""
        body_of = {int(first): i for i, first in enumerate(self.coordinates.array[:, 0])}
        bodies = [body_of.get(int(first), -1) for first in coordinates.reshape(-1)]
        return np.array(bodies, int).reshape(coordinates.shape)

    # Between flat vectors and blocks.

    def split(self, x: Float[Array, "n *k"]) -> Float[Array, "bodies size *k"]:
        return self.coordinates.take(x)

    def split_rows(self, x: Float[Array, "m *k"]) -> Float[Array, "nodes height *k"]:
        return self.rows.take(x)

    def join(self, x: Float[Array, "bodies size *k"]) -> Float[Array, "n *k"]:
        return take(_joined(x), self._unpadded(self.coordinates, self.n))

    def join_rows(self, x: Float[Array, "nodes height *k"]) -> Float[Array, "m *k"]:
        return take(_joined(x), self._unpadded(self.rows, self.m))

    @staticmethod
    def _unpadded(index: Index, size: int) -> np.ndarray:
        return np.argsort(index.array.reshape(-1), kind="stable")[:size].astype(np.uint32)

    # Products and dense forms of blocks.

    def apply_mass(
        self, blocks: Float[Array, "bodies size *size"], x: Float[Array, "n *k"]
    ) -> Float[Array, "n *k"]:
        """M x from the blocks of M, or from their diagonals (bodies, size)."""
        parts = self.split(x)
        if blocks.ndim == 2:
            return self.join(blocks.reshape(blocks.shape + (1,) * (x.ndim - 1)) * parts)
        columns = parts.reshape(*parts.shape[:2], -1)
        return self.join(multiply(blocks, columns).reshape(parts.shape))

    def apply_jacobian(self, sides: Float[Array, "sides height size"], a: Blocks) -> Blocks:
        """C a, of blocks: from the `sides` of C and the columns of all bodies."""
        each = multiply(sides, take(a, self.bodies))
        return jnp.sum(take(each, self.sides_of_nodes), axis=1)

    def apply_jacobian_transpose(
        self, sides: Float[Array, "sides height size"], multipliers: Blocks
    ) -> Blocks:
        """Cᵀ λ, of blocks: those of all nodes."""
        each = multiply_transposed(sides, take(multipliers, self.nodes))
        return jnp.sum(take(each, self.sides_of_bodies), axis=1)

    def dense_jacobian(self, sides: Float[Array, "sides height size"]) -> Float[Array, "m n"]:
        """C_q from its blocks."""
        rows = self.rows.array[self.nodes].astype(int)[:, :, None]
        columns = self.coordinates.array[self.bodies].astype(int)[:, None]
        inside = (rows < self.m) & (columns < self.n)
        return spread([sides], [np.where(inside, rows * self.n + columns, -1)], (self.m, self.n))

    # Properties of the sides follow.

    @property
    def nodes(self) -> np.ndarray:
        return self.sides.array.reshape(-1, 2)[:, 0]

    @property
    def bodies(self) -> np.ndarray:
        return self.sides.array.reshape(-1, 2)[:, 1]

    @functools.cached_property
    def sides_of_nodes(self) -> np.ndarray:
        """(nodes, most), padded by the number of sides."""
        return _table([np.flatnonzero(self.nodes == j) for j in range(len(self.rows.rows))])

    @functools.cached_property
    def sides_of_bodies(self) -> np.ndarray:
        """(bodies, most), padded by the number of sides."""
        return _table([np.flatnonzero(self.bodies == i) for i in range(len(self.coordinates.rows))])

    @functools.cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Nodes that share a body."""
        shared = {
            (int(self.nodes[k]), int(self.nodes[o]))
            for sides in self.sides_of_bodies
            for k in sides
            for o in sides
            if max(k, o) < len(self.nodes) and self.nodes[k] < self.nodes[o]
        }
        return tuple(sorted(shared))

    @functools.cached_property
    def pairs(self) -> Pairs:
        """The products of sides that the upper triangle of the Schur complement sums."""
        count = len(self.nodes)
        products: dict[Edge, list[int]] = {}
        left, right = list[int](), list[int]()
        for sides in self.sides_of_bodies:
            for k in sides:
                for o in sides:
                    if max(k, o) < count and self.nodes[k] <= self.nodes[o]:
                        edge = (int(self.nodes[k]), int(self.nodes[o]))
                        products.setdefault(edge, []).append(len(left))
                        left.append(k)
                        right.append(o)
        # A node meets itself on each of its bodies, so that its own block is a sum over them.
        own = [products.get((j, j), []) for j in range(len(self.rows.rows))]
        between = [products[edge] for edge in self.edges]
        size = len(left)
        return Pairs(
            np.array(left, int), np.array(right, int), _table(own, size), _table(between, size)
        )


def _table(entries: Sequence[Sequence[int] | np.ndarray], size: int | None = None) -> np.ndarray:
    """Lists of unequal length as one table, filled with one past the largest entry."""
    size = sum(map(len, entries)) if size is None else size
    table = np.full((len(entries), max(map(len, entries), default=0)), size, np.uint32)
    for row, listed in zip(table, entries, strict=True):
        row[: len(listed)] = listed
    return table


def _joined(x: Float[Array, "count size *k"]) -> Float[Array, "entries *k"]:
    """The first two axes as one; of a known length, as arrays without entries have any."""
    return x.reshape(x.shape[0] * x.shape[1], *x.shape[2:])
