"""Smooth orthogonal decomposition, with a rank that does not flip."""

from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from ...arrays import Vector
from ...fields import Converted, number
from ...program import program
from ..basis import Basis
from ..rank import FLOOR, Rank
from ..snapshots import Motions, WeightedSnapshots
from ..subspace import leading, singular_values
from .base import AbstractDecomposition, Directions, RankCriterion, ValueLabel


@final
class SOD(AbstractDecomposition):
    """Smooth orthogonal decomposition (chapter equation 39.12).

    The chapter's generalised eigenvalue problem is singular wherever a coordinate rests, and its
    rank flips with the sample rate. Here no correlation matrix is formed: the weighted velocities
    are compressed to their own r directions, V = U Σ Wᵀ; the positions, seen in these as
    Y = Σ⁻¹ Uᵀ X = P D Nᵀ, give the values λ = D² [s²] (never infinite or negative) and the modes
    U Σ P. With all modes kept, the subspace is that of the velocities' proper orthogonal modes.
    A smooth mode that oscillates alone has the frequency 1/(2π √λ) [Hz].

    `rank`, `tol`, `offset` as `POD`; they refer to the singular values of the weighted velocities.
    """

    rank: Rank | None = eqx.field(static=True, default=None)
    tol: Converted[Float[Array, ""] | None] = number(default=None)
    offset: Converted[Float[Array, " n"] | None, Vector] = number(default=None)

    name: ClassVar[str] = "SOD"
    value_label: ClassVar[ValueLabel | None] = ValueLabel(
        "Smooth orthogonal values", r"\lambda", "s$^2$"
    )

    def criterion(self, snapshots: WeightedSnapshots) -> RankCriterion:
        values = singular_values(snapshots.velocities)
        return RankCriterion(values, FLOOR[values.dtype], snapshots.noise.velocities)

    def directions(self, snapshots: WeightedSnapshots, rank: int) -> Directions:
        vectors, spectrum = leading(snapshots.velocities, rank)
        smooth, values = _smooth(snapshots, vectors)
        return Directions(smooth, values, spectrum)


def sod(
    motion: Motions,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
) -> Basis:
    """Smooth orthogonal modes and values of a motion: `SOD(rank, tol, offset)(motion)`.

    **Arguments:** `motion`: a Trajectory, or several of one mechanism; `rank`, `tol`, `offset`:
    as `SOD`.

    Raises RankError for a rank that the snapshots do not allow, InputError if they do not move or
    are not finite.
    """
    return SOD(rank, tol, offset)(motion)


@program
def _smooth(
    snapshots: WeightedSnapshots, vectors: Float[Array, "n r"]
) -> tuple[Float[Array, "n r"], Float[Array, " r"]]:
    """Orthonormal vectors of the smooth modes, in the order of their values, and the values."""
    # Up to signs R is Σ; but it follows when a derivative mixes the vectors.
    _, r = jnp.linalg.qr(snapshots.velocities.T @ vectors)
    compressed = jsl.solve_triangular(r, vectors.T @ snapshots.positions, trans=1)
    p, d = leading(compressed, vectors.shape[1])
    # All smooth modes are kept, so they span what the velocities' vectors span: how they mix these
    # does not change the derivative of the subspace.
    mix, _ = jnp.linalg.qr(jax.lax.stop_gradient(r.T @ p))
    return vectors @ mix, d**2
