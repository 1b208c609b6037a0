"""Sampling of bodies: those that stand for all, and their weights."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...compiling.program import program_once
from ..system import ReducedSystem


@program_once
def body_terms(
    exact: ReducedSystem, z: Float[Array, "K r"], w: Float[Array, "K r"]
) -> tuple[Float[Array, "K bodies r"], Float[Array, "K bodies rr"]]:
    """Return the terms of each body in the equations at states of the model that is not sampled, in
    the order of the groups: G_bᵀ(M_b q̈_b − Q_b), and the entries of G_bᵀM_bG_b.
    """
    full: Any = exact.full

    def one(state: tuple[Array, Array]) -> tuple[Array, Array]:
        z, w = state
        now = exact.state(exact.time, z, w)
        q, v, tangent, _ = now.motion
        a = now.physical_acceleration(exact.acceleration(exact.time, z, w)[0])
        # The symmetric part of each matrix once.
        upper = np.triu_indices(z.size)
        virtual, inertia = list[Array](), list[Array]()
        for group in full.bodies:
            mass, table = group.mass(q), group.coordinates.array
            mass = jax.vmap(jnp.diag)(mass) if mass.ndim == 2 else mass
            # Each body has its own rows of G: the terms Gᵀ (M a − Q) and GᵀMG are sums over the
            # bodies.
            own = tangent[table]
            force = jnp.einsum("bij,bj->bi", mass, a[table])
            acting = group.force(full.fields, q, v)
            force = force if acting is None else force - acting
            virtual.append(jnp.einsum("bir,bi->br", own, force))
            each = jnp.einsum("bir,bij,bjs->brs", own, mass, own)
            inertia.append(each[:, upper[0], upper[1]])
        return jnp.concatenate(virtual), jnp.concatenate(inertia)

    terms: tuple[Array, Array] = jax.lax.map(one, (z, w))
    return terms


def sparse_weights(terms: tuple[np.ndarray, ...], tol: float) -> np.ndarray:
    """ξ ≥ 0 of the bodies, few of them positive, with Σ ξ_b y_b = Σ y_b for all `terms` y
    (K, bodies, columns), up to about `tol`.

    The energy-conserving sampling and weighting of Farhat, Avery, Chapman and Cortial, IJNME 98,
    625 (2014), doi:10.1002/nme.4668, of bodies instead of elements. All that differs between bodies
    by more than `tol` is a few combinations, so non-negative least squares on these has a solution
    with no more positive entries than there are of them.
    """
    # Here, since it loads half of SciPy, which `import romjax` must not.
    from scipy.optimize import nnls

    rows = []
    for y in terms:
        own = np.moveaxis(y, 1, 2).reshape(-1, y.shape[1])
        size = np.linalg.norm(np.sum(np.abs(own), axis=1))
        if size > 0:
            # Both sorts of terms get one size, so that neither drowns the other.
            rows.append(own / size)
    _, values, right = np.linalg.svd(np.concatenate(rows), full_matrices=False)
    # Weights are found in the few directions that the terms vary in: the fewer rows, the fewer
    # weights that non-negative least squares leaves.
    count = int(np.sum(values > tol * values[0]))
    matrix = values[:count, None] * right[:count]
    weights, _ = nnls(matrix, np.sum(matrix, axis=1), maxiter=100 * len(right[0]))
    return np.asarray(weights)
