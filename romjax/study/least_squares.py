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
