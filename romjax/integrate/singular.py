"""Detection of positions at which the constraints of a motion lose rank."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..compiling.program import program_once
from ..system.base import AbstractSystem
from .origin import check_origin
from .trajectory import Trajectory

# Singular values below this share of the largest are those of constraints that repeat others.
_REPEATED = 1e-7
# A singular value that falls below this share of its median passes a singular position.
_FALLS = 0.2
# Joints with this share of the dependent combination take part in it.
_PARTAKES = 0.3


class SingularPosition(NamedTuple):
    """The output time of a run at which its constraints are closest to losing rank.

    - `time` [s]. `condition`: largest singular value of C_q over the smallest one that is not zero
      for the whole run, with rows of C_q of unit length in the metric of M⁻¹.
    - `joints`: those whose constraints become dependent there.
    - `is_passed`: whether the smallest one is far below what it is elsewhere.
    """

    time: float
    condition: float
    joints: tuple[str, ...]
    is_passed: bool

    def describe(self) -> str:
        """Return the position in words, with the joints."""
        return (
            f"near t = {self.time:.4g} s the constraints of {', '.join(self.joints)} become "
            f"dependent (condition {self.condition:.2g}): a singular position, at which the "
            "mechanism may branch"
        )


def singular_position(system: AbstractSystem, run: Trajectory) -> SingularPosition | None:
    """Find where the constraints come closest to losing rank; None without constraints.

    At a singular position (a change point, a dead centre) constraints that are independent
    elsewhere become dependent, multipliers are large or not unique, and the motion may continue on
    several branches. Constraints that repeat others in all positions are no singular position.

    **Arguments:** the `system`, full or reduced; one `run` of it. Looks at the output times only,
    of a run that failed at those before. Raises InputError for what is no system or no run,
    and for a run of another system.
    """
    check_origin("singular_position", system, run)
    full = system.full
    if full.m == 0:
        return None
    values, combinations = map(np.asarray, _singular_values(full, run.t, run.q))
    rank = max(int(np.max(np.sum(values > _REPEATED * values[:, :1], axis=1))), 1)
    # A run that failed counts as far as it got.
    least = np.where(np.isfinite(values[:, rank - 1]), values[:, rank - 1], np.inf)
    at = int(np.argmin(least))
    shares = np.abs(combinations[at][:, rank - 1])
    names = full.structure.constraints
    partaking = [names[i] for i in np.flatnonzero(shares >= _PARTAKES * np.max(shares))]
    floor = np.finfo(values.dtype).tiny
    return SingularPosition(
        time=float(run.t[at]),
        condition=float(values[at, 0] / max(least[at], floor)),
        joints=tuple(dict.fromkeys(partaking)),
        is_passed=bool(least[at] < _FALLS * np.median(least[np.isfinite(least)])),
    )


@program_once
def _singular_values(
    system: AbstractSystem, t: Float[Array, " k"], q: Float[Array, "k n"]
) -> tuple[Float[Array, "k least"], Float[Array, "k m least"]]:
    """Singular values and left singular vectors of the scaled C_q at each time."""

    def at(time_and_position: tuple[Array, Array]) -> tuple[Array, Array]:
        t, q = time_and_position
        rows = system.state(t, q, jnp.zeros_like(q)).jacobian()
        # With M = L Lᵀ the rows of C_q L⁻ᵀ have the lengths and the angles of those of C_q in the
        # metric of M⁻¹.
        half = jnp.linalg.cholesky(system.mass(q))
        free = jax.scipy.linalg.solve_triangular(half, rows.T, lower=True).T
        lengths = jnp.sqrt(jnp.sum(free**2, axis=1, keepdims=True))
        left, values, _ = jnp.linalg.svd(
            free / jnp.where(lengths > 0, lengths, 1), full_matrices=False
        )
        return values, left

    values: tuple[Array, Array] = jax.lax.map(at, (t, q))
    return values
