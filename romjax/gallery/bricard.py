"""Bricard's loop."""

import itertools

import numpy as np

from ..common.arrays import Number
from ..scene.effect.gravity import Gravity
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from .rods import rod, towards

# Corners of a cube, from hinge to hinge, and the axes of the hinges.
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
_AXES = ((0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))


def bricard(
    *,
    edge: float = 1.0,  # of the cube, the length of the rods [m]
    thickness: float = 0.1,  # of the rods [m]
    mass: Number = 1.0,  # of each [kg]
) -> Scene:
    """Five rods along edges of a cube, with the ground as the sixth, on six hinges.

    By the count of its joints, 5 · 6 − 6 · 5, the loop could not move; it has one freedom all the
    same, since one of the thirty rows of its hinges repeats the others. It falls along −y: problem
    A04 of the IFToMM library of computational benchmark problems (González, Dopico, Lugrís and
    Cuadrado, "A benchmarking system for MBS simulation software", Multibody Syst. Dyn. 16, 2006).
    """
    corners = edge * np.array(_CORNERS)
    rods = [
        rod(f"rod{i + 1}", a, b, mass, thickness)
        for i, (a, b) in enumerate(itertools.pairwise(corners))
    ]
    ends = [ground.at(corners[0], axis=_AXES[0])]
    ends += [towards(one, "end", axis) for one, axis in zip(rods, _AXES[1:], strict=True)]
    starts = [towards(one, "start", axis) for one, axis in zip(rods, _AXES, strict=False)]
    starts.append(ground.at(corners[-1], axis=_AXES[-1]))
    joints = [
        Revolute(a, b, name=f"hinge{i}") for i, (a, b) in enumerate(zip(starts, ends, strict=True))
    ]
    return Scene(bodies=rods, joints=joints, effects=[Gravity((0.0, -9.81, 0.0))])
