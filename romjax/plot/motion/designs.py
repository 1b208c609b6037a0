"""Runs of several designs in one picture: at the times of the first, each by its own numbers."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from ...assembly.assembled import mechanism_of
from ...assembly.disassemble import disassemble
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene


def course(run: Trajectory, t: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames n"]:
    """Coordinates of a run at other times, by Hermite's polynomials of its outputs and rates.

    Before the first output the run stands still; after the last one it is NaN.
    """
    own, q, v = np.asarray(run.t, float), np.asarray(run.q), np.asarray(run.v)
    near = np.clip(np.searchsorted(own, t, side="right") - 1, 0, max(len(own) - 2, 0))
    slack = 1e-6 * float(np.ptp(own))
    if len(own) == 1:
        return np.where(np.abs(t - own[0]) <= slack, q.T, np.nan).T
    h = own[near + 1] - own[near]
    h = np.where(h > 0, h, 1.0)  # of outputs after a stop, which are those at its time
    s = np.clip((t - own[near]) / h, 0.0, 1.0)[:, None]
    h = h[:, None]
    interpolated = (
        (1 + 2 * s) * (1 - s) ** 2 * q[near]
        + s * (1 - s) ** 2 * h * v[near]
        + s**2 * (3 - 2 * s) * q[near + 1]
        - s**2 * (1 - s) * h * v[near + 1]
    )
    # An output itself is shown as it is.
    exact = np.where(s == 0, q[near], np.where(s == 1, q[near + 1], interpolated))
    return np.where((t > own[-1] + slack)[:, None], np.nan, exact)


def scenes_of(scene: Scene, runs: Sequence[Trajectory]) -> list[Scene]:
    """Return the scene that each run is drawn by: `scene`, or where their numbers differ, such as
    those of two designs, the scene of each; of a run that does not know its own, `scene`.
    """
    # Systems of other makers, whose coordinates are those of the scene, have no scene.
    known = [None if run.derived.parts is None else mechanism_of(run.system) for run in runs]
    own = [scene if full is None else disassemble(full) for full in known]
    numbers = [
        [np.asarray(x) for x in jax.tree.leaves(one)]
        for one, full in zip(own, known, strict=True)
        if full is not None
    ]
    same = all(
        len(x) == len(numbers[0]) and all(map(np.array_equal, x, numbers[0])) for x in numbers
    )
    return [scene] * len(runs) if same else own
