"""Newton's cradle."""

import itertools
import math

import numpy as np

from ..common.arrays import Number
from ..scene.body.rigid import RigidBody
from ..scene.curve import Circle
from ..scene.effect.contact import Contact
from ..scene.effect.gravity import Gravity
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from .digits import decimal, drawn


def newtons_cradle(
    balls: int = 5,
    *,
    mass: Number = 0.2,  # of each ball [kg]
    radius: float = 0.02,  # [m]
    length: float = 0.25,  # of the strings [m]
    angle: Number = 0.5,  # of the first ball [rad]
    clearance: float = 5e-4,  # between balls that hang [m]
    stiffness: Number = 5e8,  # of the contacts [N/m^(3/2)]
) -> Scene:
    """Balls on strings; the first is pulled aside and released.

    Contacts are Hertz's, with a force that grows as δ^(3/2) of the depth δ. Since gaps are wider
    than a contact is deep, balls collide two by two, and each passes its momentum on: the last one
    leaves as fast as the first one came, v = 2 sin(angle/2) √(m g l / (m l² + J)) l, and the others
    stay. Balls that touch would share it (Herrmann and Schmälzle, "Simple explanation of a
    well-known collision experiment", American Journal of Physics 49, 1981).
    """
    pitch = 2 * radius + clearance
    # A string from the hook, and once around.
    around = [2 * math.pi * i / 24 for i in range(25)]
    circle = drawn(np.array([(radius * math.sin(x), radius * math.cos(x)) for x in around]))
    row = [
        RigidBody(
            f"ball{i + 1}",
            mass,
            0.4 * mass * radius**2,
            angle=0.0 if i else -1.0 * angle,
            extent=((0.0, length), *circle),
            points={"hook": (0.0, length)},
        ).placed("hook", ground.pose((i * pitch, 0.0)))
        for i in range(balls)
    ]
    strings = [Revolute(b.at("hook"), ground.at((i * pitch, 0.0))) for i, b in enumerate(row)]
    contacts = [
        Contact(b.at(), a.at(), Circle(2 * radius), stiffness=stiffness)
        for a, b in itertools.pairwise(row)
    ]
    return decimal(Scene(bodies=row, joints=strings, effects=[Gravity(), *contacts]))
