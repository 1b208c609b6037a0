"""A lift of one's own: a quadratic manifold, and the formulation that reduces on it.

Geelen, Wright and Willcox 2023, doi:10.1016/j.cma.2022.115717.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import romjax as rj
from romjax.reduction.lift.base import AbstractLift, Motion, differentiate

# Newton steps to the nearest point of the manifold; its curvature is mild, so few are enough.
_STEPS = 8


def products(z: Float[Array, " r"]) -> Float[Array, " s"]:
    """The products z ⊗ z, each once."""
    rows, columns = np.triu_indices(len(z))
    return z[rows] * z[columns]


class QuadraticLift(AbstractLift):
    """q = q̄ + Φ z + Ψ (z ⊗ z)."""

    offset: Float[Array, " n"]
    modes: Float[Array, "n r"]
    curvature: Float[Array, "n s"]  # Ψ
    metric: Float[Array, "n n"]

    def position(self, full, t, z):
        del full, t
        return self.offset + self.modes @ z + self.curvature @ products(z)

    def motion(self, full, t, z, w) -> Motion:
        return differentiate(lambda t, z: self.position(full, t, z), t, z, w)

    def restrict(self, full, q, v):
        """Gauss–Newton to the nearest point: Gᵀ M (L(z) − q) = 0, and Gᵀ M (G w − v) = 0."""

        def closer(z, target):
            def place(z):
                return self.position(full, 0.0, z)

            tangent = jax.jacfwd(place)(z)
            weighted = tangent.T @ self.metric
            return jnp.linalg.solve(weighted @ tangent, weighted @ target(place(z)))

        z = self.modes.T @ self.metric @ (q - self.offset)
        for _ in range(_STEPS):
            z += closer(z, lambda place: q - place)
        return z, closer(z, lambda _: v)

    def with_full(self, full):
        del full
        return self


class Quadratic(rj.AbstractFormulation):
    """On the quadratic manifold through the snapshots; constraints are left to Ψ.

    What the subspace misses of them is fitted by 1, z and z ⊗ z: the first two turn q̄ and Φ, which
    are means over a curve, into a point of it and its tangent.
    """

    name: ClassVar[str] = "quadratic"

    def reduce(self, system, basis):
        snapshots = basis.snapshots
        offset, linear, curvature = _fitted(
            basis.modes, snapshots.q, basis.offset, snapshots.metric
        )
        lift = QuadraticLift(offset, linear, curvature, snapshots.metric)
        start = tuple(
            jnp.asarray(np.asarray(x)[0]) for x in (snapshots.q, snapshots.v, snapshots.t)
        )
        return rj.ReducedSystem.of(system, lift, start, summary=f"quadratic in {basis.rank} modes")


@jax.jit
def _fitted(modes, q, offset, metric):
    """The offset, Φ and Ψ that fit the snapshots best."""
    z = (q - offset[None]) @ metric @ modes
    missed = q - offset[None] - z @ modes.T
    terms = jnp.concatenate([jnp.ones_like(z[:, :1]), z, jax.vmap(products)(z)], axis=1)
    fitted = jnp.linalg.lstsq(terms, missed)[0].T
    constant, linear, curvature = jnp.split(fitted, [1, 1 + modes.shape[1]], axis=1)
    return offset + constant[:, 0], modes + linear, curvature
