"""A basis in words."""

import re

import numpy as np

from .basis import Basis

# A coordinate of whose motion more than this share is missed is dropped.
_DROPPED = 0.5
# What moves by less than this, relative to the largest motion, rests.
_REST = 1e-14
# The label of a modal coordinate.
_MODE = re.compile(r"^(.+)\.q(\d+)$")


def verdict(basis: Basis) -> str:
    """One paragraph on a `basis`: the rank and what decided it, what the modes hold, what they drop
    and why.
    """
    if basis.kind == "given":
        return f"{basis.rank} given modes; no snapshots to judge them by."
    recording = basis.recording
    moved = np.asarray(recording.q - basis.offset[None])
    missed = moved - np.asarray(basis.coordinates @ basis.modes.T)
    reach, lost = np.max(np.abs(moved), axis=0), np.max(np.abs(missed), axis=0)
    labels = recording.labels or tuple(f"coordinate {i + 1}" for i in range(len(reach)))
    names = [_MODE.sub(r"bending mode \2 of \1", label) for label in labels]
    rests = reach <= _REST * np.max(reach)
    gone = (lost > _DROPPED * reach) & ~rests
    worst = int(np.argmax(np.where(rests | gone, 0, lost / np.where(rests, 1, reach))))
    words = [
        f"{basis.kind}, {basis.reason}.",
        f"The modes hold all but {float(basis.leak):.1e} of the motion",
    ]
    if lost[worst] > 0 and not (rests | gone)[worst]:
        words[-1] += f", of {names[worst]} all but {lost[worst] / reach[worst]:.1e}"
    words[-1] += "."
    if np.any(gone):
        shares = np.sqrt(np.diag(recording.metric)) * np.linalg.norm(moved, axis=0)
        shares /= np.linalg.norm(moved @ np.linalg.cholesky(recording.metric))
        places = np.flatnonzero(gone)
        each = [f"{names[i]}, because it is only {shares[i]:.1e} of the motion" for i in places]
        words.append(f"Dropped: {'; '.join(each)}.")
    if np.any(rests):
        words.append(f"At rest: {', '.join(names[i] for i in np.flatnonzero(rests))}.")
    return " ".join(words)
