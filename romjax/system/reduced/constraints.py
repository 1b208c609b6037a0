"""Which constraints a reduced model still needs."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ..base import AbstractSystem

# A constraint is kept if the basis can move along it by this share of what the full model can.
# Cart-pendulum: the values are 0.018 | 1.0, 6e-5 | 1.0, 0.77 at r = 3 | 4 | 5. Keeping the small
# ones locks the mechanism, dropping the large ones sets it free.
THRESHOLD = 0.05
_SNAPSHOTS = 200


class Selection(NamedTuple):
    """The combinations of constraints that a reduced model keeps."""

    combinations: Float[Array, "m kept"]  # Uᵀ C are the kept constraints
    visible: Float[Array, " k"]  # how much of each combination the basis can move along


def select_constraints(system: AbstractSystem, basis: Basis, count: int | None) -> Selection:
    """Principal components of the reduced constraints over the snapshots.

    Linear constraints vanish in the subspace, since all snapshots satisfy them; what is left of
    their Jacobian is rounding noise, which a plain solver takes for a pivot. The rows are scaled to
    unit length in the mass metric, so that the values know no units: 1 is a constraint that the
    basis feels as the full model does, 0 one that it cannot violate.
    """
    stride = -(-basis.coordinates.shape[0] // _SNAPSHOTS)
    z, t = basis.coordinates[::stride], basis.t[::stride]

    def reduced(t, z):  # type: ignore[no-untyped-def]
        q = basis.offset + basis.modes @ z
        saddle = system.saddle(t, q)
        return saddle.scale[:, None] * saddle.jacobian @ basis.modes, saddle.scale

    rows, scales = jax.jit(jax.vmap(reduced))(t, z)
    stacked = jnp.concatenate(list(rows), axis=1) / jnp.sqrt(rows.shape[0])
    vectors, values, _ = jnp.linalg.svd(stacked, full_matrices=False)
    if count is None:
        if isinstance(values, jax.core.Tracer):
            raise ValueError(
                "reduce: under jit, grad or vmap say how many constraints to keep, "
                "constraints=…; find the number first, outside (rom.m)."
            )
        count = int(np.sum(np.asarray(values) > THRESHOLD))
    scale = jnp.mean(scales, axis=0)
    return Selection(scale[:, None] * vectors[:, :count], values)


def active_freedoms(system: AbstractSystem, basis: Basis) -> int | None:
    """Degrees of freedom that the snapshots use and the basis resolves; None while JAX traces.

    Counted in independent coordinates (chosen by a pivoted QR of C_q), among the directions that
    stand above the first one that the basis drops.
    """
    if isinstance(basis.modes, jax.core.Tracer) or isinstance(system.q0, jax.core.Tracer):
        return None
    q = np.asarray(basis.offset + basis.coordinates @ basis.modes.T)
    jacobian = np.asarray(system.jacobian(basis.t[0], basis.offset))
    mass = np.asarray(system.mass(basis.offset))
    if system.m:
        # Pivots are the coordinates that the constraints determine: the heaviest in the metric.
        _, _, pivots = scipy.linalg.qr(jacobian / np.sqrt(np.diag(mass)), pivoting=True)
        free = np.sort(pivots[system.m :])
    else:
        free = np.arange(system.n)
    moved = (q - np.asarray(basis.offset))[:, free] * np.sqrt(np.diag(mass))[free]
    spread = np.linalg.svd(moved, compute_uv=False)
    whole = np.linalg.norm(np.asarray(basis.coordinates), ord=2)
    if not whole > 0:
        return 0
    values = np.asarray(basis.spectrum)
    dropped = values[basis.rank] / values[0] if basis.rank < len(values) else 0.0
    return int(np.sum(spread / whole > max(2 * dropped, 1e-12)))
