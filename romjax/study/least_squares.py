"""Nonlinear least squares by Levenberg and Marquardt's method.

The search is not compiled, only what it evaluates: in a program of the search a whole simulation
with its derivatives would stand several times, and take as many times as long to compile.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# Of the decrease that the linear model predicts, the shares below which a step is not taken, and
# above which the next one may be longer; and by how much the damping then changes.
_LEAST, _MOST = 0.01, 0.99
_MORE, _LESS = 4.0, 1 / 3.5

# Residuals (k,) and their derivatives (k, p) at a point (p,).
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Solution(NamedTuple):
    """Where a search ended, after how many steps, and whether it has converged."""

    x: Float[np.ndarray, " p"]
    steps: int
    success: bool


def levenberg_marquardt(
    evaluate: Evaluate,
    x: Float[np.ndarray, " p"],
    *,
    steps: int,
    tol: float,
    tell: Callable[[], object],
) -> Solution:
    """The nearest minimum of ½|r(x)|² (Marquardt 1963, doi:10.1137/0111030), with a damping that
    begins at one: residuals should be of that size.

    **Arguments:**

    - `evaluate`: residuals and derivatives at a point; where they are not finite, nothing is.
    - `x` (p,): the start. `steps`: the most of them; `tell` is called after each.
    - `tol`: the changes of x and of the sum, relative where these exceed one, that end the search.
    """
    residuals, jacobian = evaluate(x)
    half, damping = 0.5 * float(residuals @ residuals), 1.0
    for number in range(1, steps + 1):
        rows = np.concatenate([jacobian, np.sqrt(damping) * np.eye(len(x))])
        wanted = np.concatenate([-residuals, np.zeros(len(x))])
        change = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        left = residuals + jacobian @ change
        predicted = half - 0.5 * float(left @ left)
        tried = evaluate(x + change)
        tell()
        # Any comparison with what is not a number is false.
        reached = 0.5 * float(tried[0] @ tried[0])
        decrease = half - reached
        taken = bool(decrease >= _LEAST * predicted and np.all(np.isfinite(tried[1])))
        small = np.max(np.abs(change) / (tol + tol * np.abs(x))) < 1
        ended = small and abs(decrease) < tol + tol * half
        # What rounding leaves of a sum cannot decrease.
        least = predicted <= np.finfo(float).eps * half
        if taken:
            x, half, (residuals, jacobian) = x + change, reached, tried
        if least or (taken and ended):
            return Solution(x, number, True)
        if not taken:
            damping *= _MORE
        elif decrease >= _MOST * predicted:
            damping *= _LESS
    return Solution(x, steps, False)
