"""What a decomposition of snapshots is."""

import abc
import dataclasses
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis import Basis
from ..build import modes_of, projection_error
from ..rank import Rank, choose_rank
from ..snapshots import Motions, SnapshotSet, WeightedSnapshots, weigh


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

    def __call__(self, motion: Motions) -> Basis:
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
