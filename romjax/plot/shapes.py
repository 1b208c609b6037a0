"""How large modes are drawn."""

import numpy as np
from jaxtyping import Float

from ..assembly.outlines import outlines
from ..scene.scene import Scene

VISIBLE = 0.15  # largest displacement, as a share of the mechanism's size


def amplitudes(
    scene: Scene, t: float, reference: Float[np.ndarray, " n"], modes: Float[np.ndarray, "n r"]
) -> Float[np.ndarray, " r"]:
    """How much of each of the `modes` (n, r), from the configuration `reference` (n,) at t [s],
    displaces the point that moves most by 15 % of the mechanism's size; 0 of those that displace
    nothing.
    """
    largest = np.max(np.abs(modes), axis=0)
    steps = 1e-6 / np.where(largest > 0, largest, 1.0)
    drawn = outlines(scene, t, np.stack([reference, *(reference[:, None] + steps * modes).T]))
    points = np.concatenate([o.points for o in drawn if o.style == "body"], axis=1)
    speeds = np.max(np.linalg.norm(points[1:] - points[:1], axis=2), axis=1) / steps
    size = np.linalg.norm(np.max(points[0], axis=0) - np.min(points[0], axis=0))
    return np.where(speeds > 0, VISIBLE * size / np.where(speeds > 0, speeds, 1.0), 0.0)
