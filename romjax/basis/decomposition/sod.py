"""Smooth orthogonal decomposition, with a rank that does not flip."""

from typing import Any, ClassVar, Literal, final

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from ...common import precision
from ...common.arrays import Vector
from ...common.errors import InputError
from ...common.fields import Converted, number
from ...compiling.program import program
from ..basis import AbstractDecomposition, Basis, Directions, RankCriterion, ValueLabel
from ..rank import Rank
from ..snapshots import Motions, WeightedSnapshots
from ..subspace import leading, singular_values

Compression = Literal["noise", "rank"]


@final
class SOD(AbstractDecomposition):
    """Smooth orthogonal decomposition (chapter equation 39.12).

    The chapter's generalised eigenvalue problem is singular wherever a coordinate rests, and its
    rank flips with the sample rate. Here no correlation matrix is formed: the weighted velocities
    are compressed to their own leading directions, V = U Σ Wᵀ; the positions, seen in these as
    Y = Σ⁻¹ Uᵀ X = P D Nᵀ, give the values λ = D² [s²] (never infinite or negative) and the modes
    U Σ P = V W P, the smoothest first. With all modes kept, the subspace is that of the velocities'
    proper orthogonal modes. A smooth mode that oscillates alone has the frequency 1/(2π √λ) [Hz].

    - `rank`, `tol`, `offset`: as `POD`; they refer to the singular values of the weighted
      velocities.
    - `compress`: to which directions of the velocities. "noise": to all that are above rounding and
      the errors of the simulation, of whose modes the smoothest are kept. "rank": to as many as
      there will be modes, the chapter's own five, whose subspace is that of velocities alone.

    Raises InputError for another word as `compress`.
    """

    rank: Rank | None = eqx.field(static=True, default=None)
    tol: Converted[Float[Array, ""] | None] = number(default=None)
    offset: Converted[Float[Array, " n"] | None, Vector] = number(default=None)
    compress: Compression = eqx.field(static=True, default="noise")

    name: ClassVar[str] = "SOD"
    value_label: ClassVar[ValueLabel | None] = ValueLabel(
        "Smooth orthogonal values", r"\lambda", "s$^2$"
    )

    def __check_init__(self) -> None:
        if self.compress not in ("noise", "rank"):
            raise InputError(f'SOD: compress={self.compress!r}; it must be "noise" or "rank".')

    def criterion(self, snapshots: WeightedSnapshots) -> RankCriterion:
        values = singular_values(snapshots.velocities)
        floor = precision.of(values.dtype).singular_values
        return RankCriterion(values, floor, snapshots.noise.velocities)

    def directions(self, snapshots: WeightedSnapshots, rank: int) -> Directions:
        return Directions(*_smooth(snapshots, rank, self.compress))


def sod(
    motion: Motions,
    rank: Rank | None = None,
    *,
    tol: float | None = None,
    offset: Any = None,
    compress: Compression = "noise",
) -> Basis:
    """Smooth orthogonal modes and values of a motion: `SOD(rank, tol, offset, compress)(motion)`.

    **Arguments:** `motion`: a Trajectory, or several of one mechanism; `rank`, `tol`, `offset`,
    `compress`: as `SOD`.

    Raises RankError for a rank that the snapshots do not allow, InputError if they do not move or
    are not finite.
    """
    return SOD(rank, tol, offset, compress)(motion)


@program
def _smooth(
    snapshots: WeightedSnapshots, rank: int, compress: Compression
) -> tuple[Float[Array, "n r"], Float[Array, " r"], Float[Array, " k"]]:
    """Orthonormal vectors of the smoothest modes, their values, and the velocities' spectrum."""
    positions, velocities = snapshots.positions, snapshots.velocities
    vectors, values = leading(velocities, rank)
    _, spectrum, w = jnp.linalg.svd(jax.lax.stop_gradient(velocities), full_matrices=False)
    used = jnp.arange(len(spectrum)) < rank
    if compress == "noise":
        floor = precision.of(spectrum.dtype).singular_values
        level = jnp.maximum(floor * spectrum[0], snapshots.noise.velocities)
        used |= spectrum > jax.lax.stop_gradient(level)
    # U. Its derivative needs none of W, which turns to what is below the noise only.
    sizes = jax.lax.stop_gradient(jnp.where(used, spectrum, 1.0))
    own = velocities @ (w.T * (used / sizes)[None])
    if compress == "rank":
        # Or to directions like those that are kept, as U does.
        own = vectors @ (vectors.T @ own)
    # Q is U and R is Σ, up to signs; ones for the directions that are not used keep R regular.
    q, r = jnp.linalg.qr(jnp.concatenate([own, jnp.diag(1.0 * ~used)]))
    q, r = q[: len(velocities)], r * sizes[None]
    compressed = jsl.solve_triangular(r, q.T @ positions)
    p, d = leading(compressed, rank)
    mix, _ = jnp.linalg.qr(r @ p)
    return q @ mix, d[:rank] ** 2, values
