"""The decompositions as the chapter prints them: for comparison only, never for reduction."""

from typing import NamedTuple

import numpy as np

from ...common.checks import check_one_run
from ..snapshots import Motion


class NaiveSod(NamedTuple):
    """The result of standard tools for SOD on raw, uncentred, unweighted snapshots.

    - `values` (n,): smooth orthogonal values [s²], infinite where a direction rests; largest first.
    - `modes` (n, n): smooth orthogonal modes, its columns: neither of a length nor orthogonal.
    - `rank`: numerical rank of the matrix of modes.
    """

    values: np.ndarray
    modes: np.ndarray
    rank: int


def naive_sod(motion: Motion) -> NaiveSod:
    """The book chapter's generalised SVD of raw snapshots (equation 39.13), by QR and CS
    decomposition: to compare with; `romjax.sod` is what reductions take.

    Its rank is decided at the level of rounding errors of the largest coordinate: it may count a
    mode that moves by 4e-16 m, and leave it out at 3e-16 m.

    **Arguments:**

    - `motion`: such as a run, with q and v (k, n).
    """
    check_one_run("naive_sod", motion.t)
    x, v = np.asarray(motion.q), np.asarray(motion.v)
    joint, triangle = np.linalg.qr(np.vstack([x, v]))
    _, cosine, rotation = np.linalg.svd(joint[: len(x)])
    cosine = np.clip(np.pad(cosine, (0, x.shape[1] - len(cosine))), 0.0, 1.0)
    sine = np.linalg.norm(joint[len(x) :] @ rotation.T, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(sine > 0, (cosine / sine) ** 2, np.inf)
    order = np.argsort(-values, kind="stable")
    modes = (rotation @ triangle).T[:, order]
    return NaiveSod(values[order], modes, int(np.linalg.matrix_rank(modes)))
