"""Stress resultants as numbers along bodies, for pictures that show them in colour."""

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from ..common.errors import InputError
from ..integrate.trajectory import Trajectory
from ..measure.resultants import Resultants, Slender, resultants
from ..scene.scene import Scene
from ..system.base import AbstractSystem

Quantity = Literal["moment", "axial", "shear", "torque"]
CUTS = 41  # of each body, at even distances

_NAMES = {
    "moment": "bending moment [N m]",
    "axial": "axial force [N]",
    "shear": "shear force [N]",
    "torque": "twisting moment [N m]",
}


def name_of(owner: str, quantity: str, dimension: int) -> str:
    """A quantity in words, with its unit; raises InputError for one that is not known there."""
    known = [name for name in get_args(Quantity) if dimension == 3 or name != "torque"]
    if quantity not in known:
        where = "in space" if dimension == 3 else "in the plane"
        raise InputError(f"{owner} is '{quantity}', but {where} must be one of {known}.")
    return _NAMES[quantity]


def along_bodies(
    system: AbstractSystem, run: Trajectory, scene: Scene, quantity: Quantity
) -> dict[str, Float[np.ndarray, "k cuts"]]:
    """A resultant at the cuts of each beam and rod of a scene, by its name.

    In the plane with its sign; in space the bending moment and the shear force without one, since
    they have a direction in the section.
    """
    values = {}
    for body in scene.bodies:
        if isinstance(body, Slender):
            cuts = float(body.length) * np.linspace(-0.5, 0.5, CUTS)
            found = resultants(system, run, body, cuts)
            values[body.name] = np.asarray(_chosen(found, quantity, scene.dimension))
    return values


def _chosen(found: Resultants, quantity: Quantity, dimension: int) -> np.ndarray:
    if dimension == 2 or quantity == "axial":
        return np.asarray(getattr(found, quantity))
    moment = np.asarray(found.moment)
    if quantity == "torque":
        return moment[..., 0]
    across = moment[..., 1:] if quantity == "moment" else np.asarray(found.shear)
    sizes: np.ndarray = np.linalg.norm(across, axis=-1)
    return sizes


def largest(values: dict[str, Float[np.ndarray, "k cuts"]]) -> float:
    """The largest finite size of all values, for a scale; 1 where there is none."""
    sizes = [float(np.max(np.abs(x), where=np.isfinite(x), initial=0.0)) for x in values.values()]
    return max(sizes, default=0.0) or 1.0


def at_cuts(points: Float[np.ndarray, "frames points d"]) -> Float[np.ndarray, "frames cuts d"]:
    """The places of the cuts along a line of points at even distances."""
    places = np.linspace(0.0, len(points[0]) - 1, CUTS)
    before = np.minimum(places.astype(int), len(points[0]) - 2)
    share = (places - before)[None, :, None]
    found: np.ndarray = (1 - share) * points[:, before] + share * points[:, before + 1]
    return found
