"""The elastic law of the sections of a rod in space."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Vector, as_array, as_jax, namespace, untraced
from ....common.errors import SceneError

# Where the strains of a rod are in the order of forces along, then torques about x, y and z.
_ORDER = np.array([3, 4, 5, 0, 1, 2])


def law(
    length: Any, EI: Any, GJ: Any, EA: Any, GA: Any, coupling: Any
) -> Float[Array, "kinds kinds"]:
    """The stiffness [N m] of the amplitudes of twist and curvature times length, then of stretch
    and shear, per unit of ξ; by NumPy where JAX does not trace.
    """
    size, *own = untraced(length, GJ, EI, *(x for x in (EA, GA, coupling) if x is not None))
    xp, more = namespace(size), own[2:] if coupling is None else own[2:-1]
    diagonal = xp.concatenate([xp.atleast_1d(x) for x in (*own[:2], *more)])
    matrix = xp.diag(diagonal)
    if coupling is not None:
        matrix = matrix + own[-1]
    # ½ ∫EI κ² ds = ½ EI/L ∫(κ L)² dξ of twist and curvature, ½ ∫EA ε² ds = ½ EA L ∫ε² dξ of the
    # others: half of the power of L goes to each side of the matrix.
    bent = np.arange(len(diagonal)) < 3
    scale = xp.where(bent, 1 / xp.sqrt(size), xp.sqrt(size))
    return as_jax(scale[:, None] * matrix * scale[None])


def split(name: str, stiffness: Vector) -> dict[str, Any]:
    """The arguments of a rod for a matrix (6, 6) of its section."""
    given = as_array(stiffness)
    if given.shape != (6, 6):
        raise SceneError(
            f"body '{name}': stiffness has the shape {given.shape}; give the matrix (6, 6) of "
            "forces along, then torques about x, y and z."
        )
    (matrix,) = untraced(given)
    own = matrix[_ORDER][:, _ORDER]
    xp = namespace(own)
    diagonal = xp.diagonal(own)
    parts = {"EI": diagonal[1:3], "GJ": diagonal[0], "EA": diagonal[3], "GA": diagonal[4:]}
    return {**parts, "coupling": own - xp.diag(diagonal)}
