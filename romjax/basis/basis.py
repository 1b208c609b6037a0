"""A subspace to reduce in, and how it was found."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .snapshots import Recording


class Basis(eqx.Module):
    """An affine subspace q ≈ q̄ + Φ z.

    - `modes` Φ (n, r): orthonormal in the metric, Φᵀ M Φ = I.
    - `offset` q̄ (n,).
    - `values`: proper orthogonal values (all of them) or smooth orthogonal values (of the modes).
    - `spectrum`: the singular values that decided the rank, largest first.
    - `recording`: the snapshots it was made from.
    - `leak`: share of the snapshots that the subspace misses, in the energy norm.
    - `floor`: directions below this share of the largest are noise, of rounding or integration.
    - `kind`: "POD", "SOD" or "given"; `reason`: why the rank is what it is, in words; `tol`: the
      tolerance that was asked for, if one was.
    """

    modes: Float[Array, "n r"]
    offset: Float[Array, " n"]
    values: Float[Array, " k"]
    spectrum: Float[Array, " s"]
    recording: Recording
    leak: Float[Array, ""]
    floor: Float[Array, ""]
    kind: str = eqx.field(static=True, default="given")
    reason: str = eqx.field(static=True, default="given")
    tol: float | None = eqx.field(static=True, default=None)

    @classmethod
    def from_modes(cls, modes: Any, offset: Any) -> "Basis":
        """A basis of one's own: any independent columns `modes` (n, r) about `offset` (n,)."""
        kind = jnp.result_type(jnp.asarray(modes), jnp.asarray(offset), float)
        modes, offset = jnp.asarray(modes, kind), jnp.asarray(offset, kind)
        if modes.ndim != 2 or offset.shape != modes.shape[:1] or modes.shape[1] > modes.shape[0]:
            raise ValueError(
                f"Basis: modes {modes.shape} and offset {offset.shape} do not fit; they must have "
                "shapes (n, r) and (n,) with r at most n."
            )
        none, zero = jnp.ones(modes.shape[1], modes.dtype), jnp.zeros((), modes.dtype)
        return cls(modes, offset, none, none, Recording.still(offset), zero, zero)

    @property
    def snapshots(self):
        return self.recording

    @property
    def decomposition(self):
        return None if self.kind == "given" else self.kind

    @property
    def rank(self) -> int:
        """Number of modes r."""
        return self.modes.shape[1]

    @property
    def coordinates(self) -> Float[Array, "h r"]:
        """The snapshots in the basis, z = Φᵀ M (q − q̄)."""
        moved = self.recording.q - self.offset[None]
        return moved @ self.recording.metric @ self.modes
