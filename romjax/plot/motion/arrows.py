"""Forces of joints as arrows of a moving picture."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ...assembly.outlines import MovingOutline
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...measure.forces import joint_forces
from .frames import Model
from .outputs import held

LONGEST, HEAD = 0.15, 0.25  # of the picture's diagonal, and of an arrow


def with_forces(model: Model, run: Trajectory, chosen: Int[np.ndarray, " frames"]) -> Model:
    """A model with the forces of its joints on the bodies of their first markers, at the outputs
    `chosen` of its run. The longest arrow of all frames is a share of the picture; where a run has
    ended, arrows stay as its positions do.

    Raises InputError for a run that does not know its mechanism.
    """
    check_mechanism("forces", run)
    table = joint_forces(run.system, run)

    def over_frames(what: str, values: dict[str, Any]) -> dict[str, np.ndarray]:
        return {k: held(f"{what} of {k}", np.asarray(x)[chosen]) for k, x in values.items()}

    feet = over_frames("place", {key: own.poses[0].position for key, own in table.items()})
    forces = over_frames("force", {key: own.force for key, own in table.items()})
    places = np.concatenate(
        [o.points.reshape(-1, o.points.shape[2]) for o in model.actual if not o.endless]
    )
    sizes = (float(np.max(np.linalg.norm(x, axis=1))) for x in forces.values())
    largest = max(sizes, default=0.0)
    scale = LONGEST * float(np.linalg.norm(np.ptp(places, axis=0))) / (largest or 1.0)
    arrows = [
        MovingOutline(f"force of {key}", arrow(feet[key], scale * force), "load", False)
        for key, force in forces.items()
    ]
    undeformed = [*model.undeformed, *arrows] if model.undeformed else []
    return model._replace(actual=[*model.actual, *arrows], undeformed=undeformed)


def check_mechanism(what: str, run: Trajectory) -> None:
    """Raise InputError for a run that does not know its mechanism."""
    if getattr(run.derived, "system", None) is None:
        raise InputError(
            f"animate: {what} are those of a run that knows its mechanism, but this one is of a "
            "transformation of JAX; simulate it outside."
        )


def arrow(
    foot: Float[np.ndarray, "frames d"], way: Float[np.ndarray, "frames d"]
) -> Float[np.ndarray, "frames 5 d"]:
    """An arrow from a foot along a way: the shaft, and both sides of the head from the tip."""
    tip = foot + way
    if way.shape[1] == 2:
        across = np.stack([-way[:, 1], way[:, 0]], axis=1)
    else:  # the axis to which it is least parallel
        least = np.eye(3)[np.argmin(np.abs(way), axis=1)]
        normal = np.cross(way, least)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        size = np.linalg.norm(way, axis=1, keepdims=True)
        across = normal * size / np.where(length > 0, length, 1.0)
    sides = [tip - HEAD * (way - sign * 0.4 * across) for sign in (1, -1)]
    return np.stack([foot, tip, sides[0], tip, sides[1]], axis=1)
