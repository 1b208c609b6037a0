"""A cable that swings against a stop."""

import math

from ..common.arrays import Number
from ..scene.body.rod import Rod
from ..scene.curve import Line
from ..scene.effect.contact import Contact
from ..scene.effect.gravity import Gravity
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene


def swinging_cable(
    *,
    length: float = 1.0,  # [m]
    mass: Number = 0.5,  # [kg]
    EI: Number = 0.02,  # [N m²]
    distance: float = 0.1,  # from the hinge to the wall [m]
    places: int = 3,  # where the cable touches it
    modes: int = 5,
) -> Scene:
    """A cable, held level and released, swings down and whips against a wall, which stops it."""
    points = {f"p{i + 1}": (length * ((i + 1) / places - 0.5), 0.0) for i in range(places)}
    cable = Rod(
        "cable", mass, length, EI, modes, shapes="pinned-free", rotary=1e-4, points=points
    ).placed("start", ground.pose((0.0, 0.0)))
    wall = ground.at((-distance, 0.0), angle=-0.5 * math.pi)
    stops = [
        Contact(cable.at(name), wall, Line(), stiffness=3e4, dissipation=0.5) for name in points
    ]
    hinge = Revolute(cable.at("start"), ground.at((0.0, 0.0)), name="hinge")
    return Scene([cable], [hinge], [Gravity(), *stops])
