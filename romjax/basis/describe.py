"""A basis in words."""

import numpy as np

from ..common.checks import check_kind
from .basis import Basis

# A coordinate of whose motion more than this share is missed is dropped.
_DROPPED = 0.5
# What moves by less than this, relative to the largest motion, is at rest.
_AT_REST = 1e-14


def describe(basis: Basis) -> str:
    """One paragraph on a `basis`: the rank and what decided it, what the modes hold, what they drop
    and why. Coordinates are called by their descriptions, such as "bending mode 2 of beam".
    """
    check_kind("describe", "the basis", basis, Basis, "what romjax.pod or romjax.sod returns")
    if basis.decomposition is None:
        return f"{basis.rank} given modes; no snapshots to judge them by."
    snapshots = basis.snapshots
    displacements = np.asarray(snapshots.q - basis.offset[None])
    missed = displacements - np.asarray(basis.coordinates @ basis.modes.T)
    reach, lost = (np.max(np.abs(x), axis=0) for x in (displacements, missed))
    names = snapshots.descriptions or tuple(f"coordinate {i + 1}" for i in range(len(reach)))
    resting = reach <= _AT_REST * np.max(reach)
    dropped = (lost > _DROPPED * reach) & ~resting
    worst = int(np.argmax(np.where(resting | dropped, 0, lost / np.where(resting, 1, reach))))
    words = f"{basis.name}, {basis.summary}. "
    words += f"The modes hold all but {float(basis.projection_error):.1e} of the motion"
    if lost[worst] > 0 and not (resting | dropped)[worst]:
        words += f", of {names[worst]} all but {lost[worst] / reach[worst]:.1e}"
    words += "."
    if np.any(dropped):
        shares = _shares(displacements, np.asarray(snapshots.metric))
        each = [
            f"{names[i]}, because it is only {shares[i]:.1e} of the motion"
            for i in np.flatnonzero(dropped)
        ]
        words += f" Dropped: {'; '.join(each)}."
    if np.any(resting):
        words += f" At rest: {', '.join(names[i] for i in np.flatnonzero(resting))}."
    return words


def _shares(displacements: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """The share of each coordinate (n,) in the motion (h, n), in the energy norm."""
    own = np.sqrt(np.diag(metric)) * np.linalg.norm(displacements, axis=0)
    shares: np.ndarray = own / np.linalg.norm(displacements @ np.linalg.cholesky(metric))
    return shares
