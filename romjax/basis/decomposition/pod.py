"""Proper orthogonal decomposition."""

from typing import Any, ClassVar, final

import equinox as eqx
from jaxtyping import Array, Float

from ...common import precision
from ...common.arrays import Vector
from ...common.errors import InputError
from ...common.fields import Converted, number
from ..basis import AbstractDecomposition, Basis, Directions, RankCriterion
from ..rank import Rank
from ..snapshots import Motions, WeightedSnapshots
from ..subspace import Method, leading, singular_values


@final
class POD(AbstractDecomposition):
    """Proper orthogonal decomposition (chapter equation 39.8).

    The modes are the left singular vectors of the snapshots q − q̄, weighted by mass and time, so
    that the values mean energy-norm amplitude and do not depend on units or sample rate. They
    differentiate as a subspace, exactly, wherever the value that follows the last is smaller.
    Without `rank` and `tol`, the drop point decides. `POD(tol=1e-4)(motion)` is the Basis.

    - `rank`: number of modes, or "drop": where the values fall most steeply, if by two decades at
      least; else every direction above the noise.
    - `tol`: instead of a rank, keep the values above `tol` times the largest, and above the noise:
      rounding, and the errors that the tolerances of the simulation allow.
    - `offset`: q̄ (n,), the first configuration unless given.
    - `method`: "svd", or "gram" for the eigenvalue problem of the smaller Gram matrix (equations
      39.9, 39.10): faster for long runs, blind below 1e-7 of the largest value.

    Raises InputError for an unknown `method`.
    """

    rank: Rank | None = eqx.field(static=True, default=None)
    tol: Converted[Float[Array, ""] | None] = number(default=None)
    offset: Converted[Float[Array, " n"] | None, Vector] = number(default=None)
    method: Method = eqx.field(static=True, default="svd")

    name: ClassVar[str] = "POD"

    def __check_init__(self) -> None:
        if self.method not in ("svd", "gram"):
            raise InputError(f'POD: method={self.method!r}; it must be "svd" or "gram".')

    def criterion(self, snapshots: WeightedSnapshots) -> RankCriterion:
        values = singular_values(snapshots.positions, self.method)
        limits = precision.of(values.dtype)
        gram = self.method == "gram"
        floor = limits.gram_singular_values if gram else limits.singular_values
        return RankCriterion(values, floor, snapshots.noise.positions)

    def directions(self, snapshots: WeightedSnapshots, rank: int) -> Directions:
        vectors, values = leading(snapshots.positions, rank, self.method)
        return Directions(vectors, values, values)


def pod(
    motion: Motions,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
    method: Method = "svd",
) -> Basis:
    """Proper orthogonal modes and values of a motion: `POD(rank, tol, offset, method)(motion)`.

    **Arguments:** `motion`: a Trajectory, or several of one mechanism; `rank`, `tol`, `offset`,
    `method`: as `POD`.

    Raises RankError for a rank that the snapshots do not allow, InputError if they do not move or
    are not finite.
    """
    return POD(rank, tol, offset, method)(motion)
