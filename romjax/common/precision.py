"""Every tolerance that depends on the floating-point precision, in one record for each."""

import dataclasses
from typing import Any

import jax.numpy as jnp


@dataclasses.dataclass(frozen=True)
class Precision:
    """Tolerances for one floating-point type; plain numbers, so that no program has them as input.

    - `start_tolerance`: largest |C| and |Ċ| of a start that counts as consistent, as a share of the
      mechanism's size, as `romjax/system/start.py` says.
    - `projected`: largest |C| after Gauss–Newton sweeps, as the same share.
    - `proximal`: what is added to the unit diagonal of the scaled Schur complement.
    - `residual`: |C a − γ| relative to its terms at which sweeps of the KKT system end.
    - `newton_converged`, `newton_accepted`: last step of Newton's method for dependent
      coordinates, relative to them: what ends it, and the most with which its result is used.
    - `singular_values`, `gram_singular_values`: singular values of snapshots below this share of
      the largest one are rounding, whatever the number of snapshots; the second for those from the
      eigenvalues of a Gram matrix.
    - `dependent_rows`: a singular value of the scaled C_q between these two belongs to rows that
      this precision tells neither from repeated nor from independent ones; None if there are none.
    """

    start_tolerance: float
    projected: float
    proximal: float
    residual: float
    newton_converged: float
    newton_accepted: float
    singular_values: float
    gram_singular_values: float
    dependent_rows: tuple[float, float] | None


_DOUBLE = Precision(
    # A run at rtol = 1e-8 errs by as much anyway.
    start_tolerance=1e-8,
    # Rounding of coordinates of some hundred metres, and of constraints of some hundred terms.
    projected=1e-10,
    # Redundant constraints then leave a factor, where LU and plain Cholesky give NaN; far above
    # rounding, and small enough that two sweeps remove its effect.
    proximal=1e-10,
    # Some fifty units in the last place, which two sweeps reach.
    residual=1e-14,
    # Some units in the last place: one more step would change nothing.
    newton_converged=1e-15,
    # Below what the step size control resolves at rtol = 1e-8.
    newton_accepted=1e-9,
    # An SVD errs by some thousand units in the last place.
    singular_values=1e-12,
    # Eigenvalues are squares of singular values: half of the digits are lost.
    gram_singular_values=1e-7,
    # Not asked for: singular values down to the root of `proximal`, 1e-5, are resolved.
    dependent_rows=None,
)
_SINGLE = Precision(
    # Positions of some hundred metres are rounded to 1e-5 m.
    start_tolerance=1e-4,
    projected=1e-5,
    # Some forty units in the last place, since rounding of S makes redundant rows indefinite.
    proximal=5e-6,
    # Sweeps do not get below the effect of the proximal term in this precision.
    residual=5e-6,
    newton_converged=1e-7,
    newton_accepted=1e-4,
    singular_values=1e-6,
    gram_singular_values=1e-3,
    # Zero up to the first, which rounding leaves of rows that repeat others. Accelerations lose as
    # many digits as the square of a singular value: below the second, four of the seven.
    dependent_rows=(1e-5, 1.5e-2),
)
_BY_NAME = {"float64": _DOUBLE, "float32": _SINGLE}


def of(dtype: Any) -> Precision:
    """The tolerances for a dtype; raises TypeError if it is neither float64 nor float32."""
    name = jnp.dtype(dtype).name
    if name not in _BY_NAME:
        raise TypeError(f"romjax computes in float64 or float32, not in {name}; convert the start.")
    return _BY_NAME[name]
