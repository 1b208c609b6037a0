"""Nonlinear least squares of what takes long to compile."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Solution(NamedTuple):
    """The end of a search, the number of its steps, and whether it has converged."""

    x: Float[np.ndarray, " p"]
    steps: int
    success: bool


def least_squares(
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    begin: Float[np.ndarray, " p"],
    steps: int,
    tol: float,
) -> Solution:
    """The nearest minimum of |r(x)|², by the trust region of Branch, Coleman and Li (1999,
    doi:10.1137/S1064827595289108).

    The search is not compiled, only what it evaluates: in a program of the search a whole
    simulation with its derivatives would stand several times, and take as many times as long to
    compile.

    **Arguments:**

    - `evaluate`: residuals (k,) and derivatives (k, p) at a point.
    - `begin`: the start. `steps`: the most of them.
    - `tol`: the relative change of x or of the sum that ends the search.
    """
    import scipy.optimize  # here, since it takes long to load and few ask for it

    # SciPy asks for derivatives where it has asked for residuals last.
    @functools.lru_cache(maxsize=1)
    def at(x: bytes) -> tuple[np.ndarray, np.ndarray]:
        # Both from one run: its derivatives are forward sensitivities that are integrated with it.
        residuals, slopes = evaluate(np.frombuffer(x))
        # A step to where no derivative is known is not taken, as one to where the run fails.
        known = np.all(np.isfinite(slopes))
        return (residuals if known else np.full_like(residuals, np.nan)), slopes

    minimum = scipy.optimize.least_squares(
        lambda x: at(x.tobytes())[0],
        begin.astype(float),
        lambda x: at(x.tobytes())[1],
        method="trf",
        xtol=tol,
        ftol=tol,
        gtol=None,
        max_nfev=steps + 1,
    )
    return Solution(minimum.x, int(minimum.nfev) - 1, bool(minimum.success))


def inverse_square(jacobian: np.ndarray) -> np.ndarray:
    """(JᵀJ)⁻¹, with infinite variances of the parameters that J does not determine."""
    count = jacobian.shape[1]
    if not np.all(np.isfinite(jacobian)):
        return np.full((count, count), np.nan)
    # Columns of one size, as parameters have units.
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    _, values, right = np.linalg.svd(np.linalg.qr(jacobian / size, mode="r"))
    values = np.pad(values, (0, count - len(values)))
    # Below rounding, a combination of parameters changes nothing that was measured.
    determined = values > np.finfo(float).eps * max(jacobian.shape) * values[0]
    # With J = U Σ Vᵀ the inverse is V Σ⁻² Vᵀ, as the square of V Σ⁻¹.
    half = (right[determined] / values[determined, None]).T / size[:, None]
    undetermined = np.any(np.abs(right[~determined]) > np.sqrt(np.finfo(float).eps), axis=0)
    inverse: np.ndarray = half @ half.T + np.diag(np.where(undetermined, np.inf, 0.0))
    return inverse
