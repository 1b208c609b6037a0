"""Modes that are orthonormal in a metric."""

import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float

from ..common import precision
from ..common.arrays import concrete
from ..common.errors import InputError
from ..compiling.program import program_once


def orthonormalize(modes: Float[Array, "n r"], metric: Float[Array, "n n"]) -> Float[Array, "n r"]:
    """Modes Φ of the same span with Φᵀ M Φ = I, in the same order and directions.

    By QR of S·modes, with Sᵀ S = M: column by column what Gram and Schmidt's method gives, so modes
    that are orthonormal already come back as they are. It differentiates, and works under jit.

    Raises InputError for a metric that is not positive definite and for a column that depends on
    those before it, unless JAX traces.
    """
    orthonormal, root, lengths, heights = _factors(modes, metric)
    if (entries := concrete(root)) is not None and not np.all(np.isfinite(entries)):
        raise InputError(
            "Basis: the metric is not positive definite; give a mass matrix, such as "
            "Trajectory.metric or system.mass(system.q0)."
        )
    _refuse_dependent(lengths, heights)
    return orthonormal


@program_once
def _factors(
    modes: Float[Array, "n r"], metric: Float[Array, "n n"]
) -> tuple[Float[Array, "n r"], Float[Array, "n n"], Float[Array, " r"], Float[Array, " r"]]:
    """The modes that are orthonormal, S, the lengths of the columns of S·modes, and of each of unit
    length the part that those before it do not span.
    """
    root = jnp.linalg.cholesky(metric).T
    columns = root @ modes
    lengths = jnp.linalg.norm(columns, axis=0)
    # Columns of unit length, so that a column of metres and one of radians compare.
    q, r = jnp.linalg.qr(columns / jnp.where(lengths > 0, lengths, 1)[None])
    heights = jnp.diagonal(r)
    signs = jnp.where(heights < 0, -1.0, 1.0).astype(q.dtype)
    return jsl.solve_triangular(root, q * signs[None]), root, lengths, heights


def _refuse_dependent(lengths: Float[Array, " r"], heights: Float[Array, " r"]) -> None:
    """`heights`: of each column of unit length, the part that those before it do not span."""
    sizes, parts = concrete(lengths), concrete(heights)
    if sizes is None or parts is None:
        return
    for i, (size, part) in enumerate(zip(sizes, np.abs(parts), strict=True)):
        if not np.isfinite(size):
            why = "is not finite"
        elif size == 0:
            why = "is zero"
        elif part <= precision.of(heights.dtype).singular_values:
            why = f"lies in the span of those before it, up to {part:.1e} of it"
        else:
            continue
        raise InputError(
            f"Basis: mode {i + 1} of {len(sizes)} {why}; give independent columns of numbers."
        )
