"""Shells and beams that a program expands to solids: where the nodes of their layers are."""

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ...scene.body.component_modes import free_interface
from ...scene.body.mesh_rows import rigid_motion
from .entries import wrong

# What may be left of the rigid motions of the layers, as a share of the size of the mesh.
_FITS = 1e-6
# A spread of nodes smaller than this share of the largest one is rounding.
_FLAT = 1e-9


def layer_positions(
    path: Path, stiffness: sp.csc_array, mass: sp.csc_array, means: np.ndarray, of: np.ndarray
) -> np.ndarray:
    """Positions of the nodes of layers (layers, 3) [m], of which K and M have three rows each.

    The file has the positions of their `means` (nodes, 3), and which of these each belongs to, `of`
    (layers,). What moves a free body rigidly strains nothing, and it moves a node as its position
    says: so the positions are in K. Raises InputError where its rigid motions are not of layers
    about their means.
    """
    shares = sp.csc_array((1 / np.bincount(of)[of], (of, np.arange(len(of)))))
    size = np.max(np.ptp(means, axis=0))
    origin = means.mean(axis=0)
    arms = (means - origin[None]) / size
    moved = free_interface(stiffness, mass, 6).modes.reshape(len(of), 3, 6)
    mean = (shares @ moved.reshape(len(of), 18)).reshape(-1, 6)
    wanted = rigid_motion(arms, np.ones((len(arms), 3), bool))
    # Unit rigid motions as sums of the modes. About a line on which all nodes are, their means do
    # not turn: that motion is left out, and what is along the line tells where the layers are.
    motions = moved @ np.linalg.pinv(mean, rcond=_FLAT) @ wanted
    spread, axes = np.linalg.svd(arms - arms.mean(axis=0)[None])[1:]
    line = axes[0] if len(spread) < 2 or spread[1] < _FLAT * spread[0] else None
    turning = motions[:, :, 3:]
    if line is None:
        positions = 0.5 * np.stack(
            [
                turning[:, 1, 2] - turning[:, 2, 1],
                turning[:, 2, 0] - turning[:, 0, 2],
                turning[:, 0, 1] - turning[:, 1, 0],
            ],
            axis=1,
        )
    else:
        across = np.cross(line[None], np.eye(3))  # a · (b × x) = x · (a × b) for the axes b
        beside = np.einsum("i,lib->lb", line, turning) @ np.linalg.pinv(across).T
        positions = np.outer(arms[of] @ line, line) + beside
    left = _left(motions, positions, line)
    if not left < _FITS:
        raise wrong(
            path,
            0,
            f"the rigid motions in K do not fit nodes that stand for layers, by {left:.2g} of the "
            "size of the mesh; take supports and equations out of the model, or mesh the body "
            "by solid elements",
        )
    return np.asarray(origin[None] + size * positions)


def _left(motions: np.ndarray, positions: np.ndarray, line: np.ndarray | None) -> float:
    """The largest difference of motions (layers, 3, 6) from those of nodes at these positions."""
    rigid = rigid_motion(positions, np.ones((len(positions), 3), bool))
    apart = motions.reshape(-1, 6) - rigid
    if line is not None:  # of what turns about the line, any part is in the motions
        about = rigid[:, 3:] @ line
        apart[:, 3:] += np.outer(about, line)
        apart -= np.outer(about, about @ apart) / max(about @ about, np.finfo(float).tiny)
    return float(np.max(np.abs(apart)))
