"""Which constraints a reduced model still needs, and which freedom the snapshots use."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ..base import AbstractSystem

# A combination of constraints is kept if the basis can move along it by this share of what the
# full model can. Cart-pendulum: the shares are 0.018 | 1.0, 6e-5 | 1.0, 0.77 for POD with
# r = 3 | 4 | 5. Keeping the small ones locks the mechanism, dropping the large ones frees it.
THRESHOLD = 0.05
_SNAPSHOTS = 200


class ReducedConstraints(NamedTuple):
    """The constraints as the snapshots see them through the basis."""

    combinations: Float[Array, "m k"]  # columns U; UᵀC are combinations of the constraints
    shares: Float[Array, " k"]  # how far the basis can move along each, 1: as the full model
    jacobian: Float[Array, "m n"]  # C_q at the offset
    mass: Float[Array, " n"]  # diagonal of M at the offset


@eqx.filter_jit
def reduced_constraints(system: AbstractSystem, basis: Basis) -> ReducedConstraints:
    """Principal components of the reduced constraints over the snapshots.

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
    side_by_side = jnp.moveaxis(rows, 0, 1).reshape(rows.shape[1], -1) / np.sqrt(len(z))
    vectors, shares, _ = jnp.linalg.svd(side_by_side, full_matrices=False)
    return ReducedConstraints(
        jnp.mean(scales, axis=0)[:, None] * vectors,
        shares,
        system.jacobian(basis.recording.t[0], basis.offset),
        jnp.diagonal(system.mass(basis.offset)),
    )


def count_kept(found: ReducedConstraints) -> int:
    """How many combinations to keep; raises ValueError while JAX traces."""
    if isinstance(found.shares, jax.core.Tracer):
        raise ValueError(
            "reduce: under jit, grad or vmap say how many constraints to keep, such as "
            "constraints=2; find the number first, outside (rom.m)."
        )
    return int(np.sum(np.asarray(found.shares) > THRESHOLD))


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
    _, _, pivots = scipy.linalg.qr(np.asarray(found.jacobian) / root, pivoting=True)
    free = np.sort(pivots[len(found.jacobian) :])
    whole = np.linalg.norm(z, ord=2)
    if not whole > 0:
        return 0
    spread = np.linalg.svd(z @ (modes * root[:, None])[free].T, compute_uv=False)
    values = np.asarray(basis.spectrum)
    dropped = values[basis.rank] / values[0] if basis.rank < len(values) else 0.0
    rounding = 1e3 * np.finfo(z.dtype).eps
    return int(np.sum(spread / whole > max(2 * dropped, rounding)))
