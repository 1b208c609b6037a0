"""A catapult whose arm is a blade of spring steel."""

import math

import numpy as np

from ..common.arrays import Number
from ..scene.body.rigid import RigidBody
from ..scene.body.rod import Rod
from ..scene.curve import Polynomial
from ..scene.effect.contact import Contact
from ..scene.effect.gravity import Gravity
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from .arcs import arc


def blade_catapult(
    *,
    length: float = 0.5,  # [m]
    mass: Number = 0.04,  # [kg]
    EI: Number = 0.5,  # [N m²]
    angle: float = 0.5 * math.pi,  # by which the blade is bent [rad]
    stone_mass: Number = 0.1,  # [kg]
    radius: float = 0.02,  # of the stone [m]
    retardation: Number = 1e-3,  # of its material [s]
    modes: int = 3,
) -> Scene:
    """A blade, clamped upright and bent back to an arc, is released and throws a stone.

    The stone lies in a shallow cup at the end of the blade, and leaves it where the blade begins to
    slow down. What the blade held is ½ EI θ² / L at an angle θ.
    """
    numbers = ("blade", mass, length, EI, modes)
    amplitudes = arc(Rod(*numbers, shapes="clamped-free", loaded=True), angle)
    blade = Rod(
        *numbers,
        shapes="clamped-free",
        loaded=True,
        # The frame is that of the clamped end, where the blade is upright.
        position=(0.0, 0.5 * length),
        angle=0.5 * math.pi,
        amplitudes=amplitudes,
        retardation=retardation,
    )
    # The cup opens to the front, which is up at the start.
    cup, bowl = (0.5 * length, -radius), Polynomial((0.0, 0.0, 10.0))
    place = np.asarray(blade.pose(cup).position)
    stone = RigidBody(
        "stone",
        stone_mass,
        0.4 * stone_mass * radius**2,
        position=[round(x, 12) for x in place.tolist()],
        extent=radius,
    )
    return Scene(
        [blade, stone],
        [Weld(blade.at("start"), ground.at((0.0, 0.0), angle=0.5 * math.pi), name="clamp")],
        [
            Gravity(),
            Contact(stone.at(), blade.at(cup, angle=math.pi), bowl, stiffness=1e4, dissipation=0.5),
        ],
    )
