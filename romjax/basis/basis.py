"""A subspace to reduce in, and how it was found."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Basis(eqx.Module):
    """An affine subspace q ≈ q̄ + Φ z.

    - `modes` Φ (n, r): orthonormal in the metric, Φᵀ M Φ = I.
    - `offset` q̄ (n,).
    - `values`: proper orthogonal values (all of them) or smooth orthogonal values (of the modes).
    - `spectrum`: the singular values that decided the rank, largest first.
    - `coordinates` z (h, r), `t` (h,): the snapshots in the basis and their times.
    - `leak`: share of the snapshots that the subspace misses, in the energy norm.
    - `kind`: "POD", "SOD" or "given"; `reason`: why the rank is what it is, in words.
    - `labels`: names of the coordinates.
    """

    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    values: Float[Array, " k"]
    spectrum: Float[Array, " s"]
    coordinates: Float[Array, "h r"]
    t: Float[Array, " h"]
    leak: Float[Array, ""]
    kind: str = eqx.field(static=True, default="given")
    reason: str = eqx.field(static=True, default="given")
    labels: tuple[str, ...] = eqx.field(static=True, default=())

    @classmethod
    def from_modes(cls, modes: Any, offset: Any) -> "Basis":
        """A basis of one's own: any independent columns `modes` (n, r) about `offset` (n,)."""
        modes, offset = jnp.asarray(modes), jnp.asarray(offset)
        if modes.ndim != 2 or offset.shape != modes.shape[:1] or modes.shape[1] > modes.shape[0]:
            raise ValueError(
                f"Basis: modes {modes.shape} and offset {offset.shape} do not fit; they must have "
                "shapes (n, r) and (n,) with r at most n."
            )
        none = jnp.ones(modes.shape[1], modes.dtype)
        snapshot = jnp.zeros((1, modes.shape[1]), modes.dtype)
        zero = jnp.zeros((), modes.dtype)
        return cls(modes, offset, none, none, snapshot, zero[None], zero)

    @property
    def rank(self) -> int:
        """Number of modes r."""
        return self.modes.shape[1]
