"""A subspace to reduce in, and the ways to choose one from snapshots."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax
from ..common.errors import InputError
from .build import modes_of, projection_error
from .orthonormal import orthonormalize
from .rank import Rank, choose_rank
from .snapshots import Motions, SnapshotSet, WeightedSnapshots, weigh
from .turns import by_turn


class RankCriterion(NamedTuple):
    """The values that decide how many modes are kept, and what counts as noise in them."""

    values: Float[Array, " s"]  # singular values, largest first, without derivative
    rounding: float  # values below this share of the largest are rounding errors
    noise: Float[Array, ""]  # what integration errors add to a value, absolute


class Directions(NamedTuple):
    """A subspace in weighted coordinates, S (q − q̄)."""

    vectors: Float[Array, "n r"]  # orthonormal
    values: Float[Array, " k"]  # what the decomposition says of each; r of them, or more
    spectrum: Float[Array, " s"]  # the singular values that decided the rank


class ValueLabel(NamedTuple):
    """The names that figures give the values of a decomposition."""

    title: str  # such as "Smooth orthogonal values"
    symbol: str  # in TeX without the dollars, such as r"\lambda"
    unit: str  # in TeX, such as "s$^2$"


class AbstractDecomposition(eqx.Module):
    """A way to choose a subspace from snapshots.

    A subclass has the fields `rank`, `tol` and `offset`, a `name`, and says what decides the rank
    (`criterion`) and which subspace has a given rank (`directions`), both of weighted snapshots.
    Called with a motion, it makes the Basis. Where its values are not the singular values that
    decide the rank, a `value_label` tells figures what they are.
    """

    rank: eqx.AbstractVar[Rank | None]
    tol: eqx.AbstractVar[Float[Array, ""] | None]
    offset: eqx.AbstractVar[Float[Array, " n"] | None]

    name: eqx.AbstractClassVar[str]
    value_label: ClassVar[ValueLabel | None] = None

    @abc.abstractmethod
    def criterion(self, snapshots: WeightedSnapshots) -> RankCriterion:
        """The singular values that decide the rank, and how small ones are no more than noise."""

    @abc.abstractmethod
    def directions(self, snapshots: WeightedSnapshots, rank: int) -> Directions:
        """The subspace of that rank; it may be differentiated."""

    def with_rank(self, rank: Rank, offset: Any = None) -> "AbstractDecomposition":
        """The same decomposition to a number of modes; about `offset` (n,), if that is given."""
        about = self.offset if offset is None else jnp.asarray(offset)
        return dataclasses.replace(self, rank=rank, tol=None, offset=about)

    def __call__(self, motion: Motions) -> "Basis":
        """The Basis of a motion, or of several of one mechanism.

        Raises RankError for a rank that the snapshots do not allow, InputError if they do not move
        or are not finite.
        """
        snapshots = SnapshotSet.of(motion)
        weighted = weigh(snapshots, self.offset)
        values, rounding, noise = self.criterion(weighted)
        chosen = choose_rank(self.name, values, self.rank, self.tol, rounding, noise)
        vectors, values, spectrum = self.directions(weighted, chosen.rank)
        return Basis(
            modes=modes_of(weighted.root, vectors),
            offset=weighted.offset,
            values=values,
            spectrum=spectrum,
            snapshots=snapshots,
            projection_error=projection_error(weighted.positions, vectors),
            floor=chosen.floor,
            decomposition=self,
            summary=chosen.reason,
        )


class Basis(eqx.Module):
    """An affine subspace q ≈ q̄ + Φ z.

    - `modes` Φ (n, r): orthonormal in the metric of the snapshots, Φᵀ M Φ = I.
    - `offset` q̄ (n,).
    - `values`: proper orthogonal values (all of them) or smooth orthogonal values (of the modes).
    - `spectrum`: the singular values that decided the rank, largest first.
    - `snapshots`: what it was made from.
    - `projection_error`: share of the snapshots that the subspace misses, in the energy norm.
    - `floor`: directions below this share of the largest are noise, of rounding or integration.
    - `decomposition`: the object that made it, such as `POD(tol=1e-4)`; None for given modes.
    - `summary`: why the rank is what it is, in words.
    """

    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    values: Float[Array, " k"]
    spectrum: Float[Array, " s"]
    snapshots: SnapshotSet
    projection_error: Float[Array, ""]
    floor: Float[Array, ""]
    decomposition: AbstractDecomposition | None = None
    summary: str = eqx.field(static=True, default="given")

    @classmethod
    def from_modes(cls, modes: Any, offset: Any, metric: Any = None) -> "Basis":
        """A basis of one's own.

        **Arguments:**

        - `modes` (n, r): independent columns, which are made orthonormal; the span stays.
        - `offset` (n,): q̄.
        - `metric` (n, n): mass matrix in which they are orthonormal; the identity unless given.

        Raises InputError for shapes that do not fit, for columns that depend on each other, and for
        a metric that is not positive definite.
        """
        dtype = jnp.result_type(jnp.asarray(modes), jnp.asarray(offset), float)
        modes, offset = jnp.asarray(modes, dtype), jnp.asarray(offset, dtype)
        if modes.ndim != 2 or offset.shape != modes.shape[:1] or modes.shape[1] > modes.shape[0]:
            raise InputError(
                f"Basis: modes {modes.shape} and offset {offset.shape} do not fit; they must have "
                "shapes (n, r) and (n,) with r at most n."
            )
        metric = _metric(metric, offset)
        ones, zero = as_jax(np.ones(modes.shape[1], dtype)), as_jax(np.zeros((), dtype))
        snapshots = SnapshotSet.single(offset, metric)
        return cls(orthonormalize(modes, metric), offset, ones, ones, snapshots, zero, zero)

    def orthonormalised(self, metric: Any) -> "Basis":
        """The same subspace and the same snapshots, with modes orthonormal in `metric` (n, n).

        `values`, `spectrum` and `projection_error` stay those of the metric before. Raises
        InputError for a metric of another shape or one that is not positive definite.
        """
        metric = _metric(metric, self.offset)
        snapshots = dataclasses.replace(self.snapshots, metric=metric)
        modes = orthonormalize(self.modes, metric)
        return dataclasses.replace(self, modes=modes, snapshots=snapshots)

    def of_unit_length(self, columns: Sequence[int]) -> "Basis":
        """Return the basis with its quaternions, which begin at `columns`, of unit length."""
        snapshots, offset = self.snapshots.of_unit_length(columns), self.offset
        if snapshots.turns is not None:
            offset = by_turn(snapshots.turns, offset)
        return dataclasses.replace(self, snapshots=snapshots, offset=offset)

    @property
    def rank(self) -> int:
        """Number of modes r."""
        return self.modes.shape[1]

    @property
    def name(self) -> str:
        """The name of the decomposition: "POD", "SOD", or "given modes"."""
        return "given modes" if self.decomposition is None else self.decomposition.name

    @property
    def tol(self) -> Float[Array, ""] | None:
        """The tolerance that was asked for, if one was."""
        return None if self.decomposition is None else self.decomposition.tol

    @property
    def coordinates(self) -> Float[Array, "h r"]:
        """The snapshots in the basis, z = Φᵀ M (q − q̄)."""
        displacements = self.snapshots.q - self.offset[None]
        return displacements @ self.snapshots.metric @ self.modes


def _metric(metric: Any, offset: Float[Array, " n"]) -> Float[Array, "n n"]:
    """The metric as an array that fits the offset; the identity if it is None."""
    n = len(offset)
    if metric is None:
        return as_jax(np.eye(n, dtype=offset.dtype))
    array = jnp.asarray(metric, offset.dtype)
    if array.shape != (n, n):
        raise InputError(f"Basis: metric has shape {array.shape}, but it must have ({n}, {n}).")
    return array
