"""Choice of the coordinates of a motion that are shown."""

from collections.abc import Sequence

import numpy as np

from ..integrate.trajectory import Trajectory
from ..study.compare import compare

MOST = 8  # unless the coordinates are named


def choose(
    owner: str, truth: Trajectory, coordinates: Sequence[str] | None, most: int = MOST
) -> tuple[list[int], str]:
    """The columns of q to show, and a note if some that move are left out.

    `coordinates` are labels; without them, those that move. Of more than `most`, the ones whose
    motion is largest in the metric, √M_ii max |q_i − q_i(0)|, since metres and radians do not
    compare.
    """
    labels = list(truth.labels)
    if coordinates is not None:
        unknown = [name for name in coordinates if name not in labels]
        if unknown or len(coordinates) == 0:
            what = f"there is no coordinate '{unknown[0]}'" if unknown else "no coordinates given"
            raise ValueError(f"{owner}: {what}; the motion has: {', '.join(labels)}.")
        return [labels.index(name) for name in coordinates], ""
    moving = np.flatnonzero(np.asarray(compare(truth, truth).moving))
    if not len(moving):
        moving = np.arange(len(labels))
    if len(moving) <= most:
        return moving.tolist(), ""
    q = np.asarray(truth.q)
    reach = np.sqrt(np.diag(np.asarray(truth.metric))) * np.max(np.abs(q - q[0]), axis=0)
    largest = np.sort(moving[np.argsort(-reach[moving], kind="stable")[:most]])
    note = f"the {most} of {len(moving)} moving coordinates that move most in the mass metric"
    return largest.tolist(), note
