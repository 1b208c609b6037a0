"""A comparison of arrays that says how far they differ, and where."""

import numpy as np


def assert_close(actual, wanted, tol, scale=None):
    """Fail unless |actual − wanted| ≤ tol · scale everywhere; NaN anywhere fails.

    **Arguments:**

    - `actual`, `wanted`: numbers or arrays; `wanted` may broadcast to the shape of `actual`.
    - `tol`: the tolerance, and `scale` what it is relative to, a number or an array that
      broadcasts; absolute without it.
    """
    actual, wanted = np.asarray(actual), np.asarray(wanted)
    shape = np.broadcast_shapes(actual.shape, wanted.shape)
    assert shape == actual.shape, f"shape {actual.shape}, but wanted {wanted.shape}"
    error = np.abs(actual - wanted)
    allowed = np.broadcast_to(tol * np.asarray(1.0 if scale is None else scale), shape)
    # Written so that a NaN on either side counts as an error.
    failed = ~(error <= allowed)
    if not np.any(failed):
        return
    excess = np.where(np.isnan(error), np.inf, error - allowed)
    worst = np.unravel_index(int(np.argmax(np.where(failed, excess, -np.inf))), shape)
    at = f" at {tuple(map(int, worst))}" if shape else ""
    raise AssertionError(
        f"error {error[worst]:.3g} > {allowed[worst]:.3g} (tol {tol:.3g}){at}: "
        f"{actual[worst]:.16g}, but wanted {np.broadcast_to(wanted, shape)[worst]:.16g}; "
        f"{np.count_nonzero(failed)} of {failed.size} entries fail"
    )
