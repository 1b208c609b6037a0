"""Which constraints a reduced model still needs, and which freedom the snapshots use."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ...basis.subspace import leading
from ..base import AbstractSystem

# A combination of constraints is kept if the basis can move along it by this share of what the
# full model can. Cart-pendulum: the shares are 0.018 | 1.0, 6e-5 | 1.0, 0.77 for POD with
# r = 3 | 4 | 5. Keeping the small ones locks the mechanism, dropping the large ones frees it.
THRESHOLD = 0.05
# A motion that violates the constraints by more than this share of what free parts would is no
# motion of the mechanism. Reduced models with 0.1 err by 1 %, with 0.2 by 50 %.
LOOSE = 0.15
_SNAPSHOTS = 200


class ReducedConstraints(NamedTuple):
    """The constraint Jacobian at the snapshots, in the basis; rows of unit length in the metric."""

    rows: Float[Array, "K m r"]
    scale: Float[Array, " m"]  # of the rows, on average
    jacobian: Float[Array, "m n"]  # C_q at the offset
    mass: Float[Array, " n"]  # diagonal of M at the offset

    @property
    def side_by_side(self) -> Float[Array, "m rK"]:
        return jnp.moveaxis(self.rows, 0, 1).reshape(self.rows.shape[1], -1) / len(self.rows) ** 0.5

    def combinations(self, count: int) -> Float[Array, "m count"]:
        """The principal ones: columns U, so that UᵀC are combinations of the constraints."""
        vectors, _ = leading(self.side_by_side, count)
        return self.scale[:, None] * vectors


@eqx.filter_jit
def reduced_constraints(system: AbstractSystem, basis: Basis) -> ReducedConstraints:
    """What the basis can violate, at the snapshots.

    Linear constraints vanish in the subspace, since all snapshots satisfy them; what is left of
    their Jacobian is rounding noise, which a plain solver takes for a pivot. The rows are scaled to
    unit length in the mass metric, so that the shares know no units.
    """
    stride = -(-len(basis.recording.t) // _SNAPSHOTS)
    z, t = basis.coordinates[::stride], basis.recording.t[::stride]

    def reduced(t, z):  # type: ignore[no-untyped-def]
        q = basis.offset + basis.modes @ z
        saddle = system.saddle(t, q)
        scale = saddle.topology.join_rows(saddle.scale)
        return scale[:, None] * system.jacobian(t, q) @ basis.modes, scale

    rows, scales = jax.vmap(reduced)(t, z)
    return ReducedConstraints(
        rows,
        jnp.mean(scales, axis=0),
        system.jacobian(basis.recording.t[0], basis.offset),
        jnp.diagonal(system.mass(basis.offset)),
    )


def count_kept(found: ReducedConstraints, active: int) -> int:
    """How many combinations to keep: those the basis can move along, at most r − active."""
    shares = np.linalg.svd(np.asarray(found.side_by_side), compute_uv=False)
    return min(int(np.sum(shares > THRESHOLD)), found.rows.shape[2] - active)


def looseness(found: ReducedConstraints, combinations: Float[Array, "m k"]) -> tuple[float, int]:
    """How far the motion that is left free violates the constraints, and the one it violates most.

    The largest singular value over the snapshots of the scaled Jacobian, on the null space of what
    is kept: zero for a mechanism that stays one, one for parts that have lost their joints.
    """
    rows = np.asarray(found.rows)
    kept = np.asarray(combinations / found.scale[:, None])
    worst, row = 0.0, 0
    for jacobian in rows:
        _, values, right = np.linalg.svd(kept.T @ jacobian)
        rank = int(np.sum(values > 1e-9))
        free = jacobian @ right[rank:].T
        size = float(np.linalg.norm(free, 2)) if free.size else 0.0
        if size > worst:
            worst, row = size, int(np.argmax(np.linalg.norm(free, axis=1)))
    return worst, row


def active_freedoms(found: ReducedConstraints, basis: Basis) -> int | None:
    """Degrees of freedom that the snapshots use and the basis resolves; None while JAX traces.

    Counted in independent coordinates (chosen by a pivoted QR of C_q), among the directions that
    stand above the first one that the basis drops.
    """
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((found, basis))):
        return None
    root = np.sqrt(np.asarray(found.mass))
    z, modes = np.asarray(basis.coordinates), np.asarray(basis.modes)
    # The pivots are the coordinates that the constraints determine: the lightest in the metric.
    scaled = np.asarray(found.jacobian) / root
    _, _, pivots = scipy.linalg.qr(scaled, pivoting=True)
    rank = (
        np.linalg.matrix_rank(scaled, tol=1e-9 * np.max(np.abs(scaled), initial=0))
        if len(scaled)
        else 0
    )
    free = np.sort(pivots[rank:])
    whole = np.linalg.norm(z, ord=2)
    if not whole > 0:
        return 0
    spread = np.linalg.svd(z @ (modes * root[:, None])[free].T, compute_uv=False)
    values = np.asarray(basis.spectrum)
    dropped = values[basis.rank] / values[0] if basis.rank < len(values) else 0.0
    rounding = 1e3 * np.finfo(z.dtype).eps
    return int(np.sum(spread / whole > max(2 * dropped, rounding)))
