"""A trebuchet with a hanging counterweight and a sling."""

import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.curve import Line
from ..scene.effect.contact import Contact
from ..scene.effect.gravity import Gravity
from ..scene.joint.distance import Distance
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene


def trebuchet(
    *,
    counterweight: Number = 1000.0,  # [kg]
    stone_mass: Number = 10.0,  # [kg]
    beam_density: Number = 10.0,  # [kg/m]
    short: float = 1.2,  # arms of the beam [m]
    long: float = 5.0,
    height: float = 3.2,  # of the pivot [m]
    hanger: float = 1.3,  # from the beam to the middle of the counterweight [m]
    sling: float = 4.5,  # [m]
) -> Scene:
    """A counterweight turns a beam, whose sling pulls a stone along a trough and throws it.

    The stone starts at rest in a trough without friction, below the pivot, and leaves it when the
    sling lifts it. The sling is a massless link; it should open when the stone moves upwards at
    45°. From there the range is v²/g on the level, at most 2 (M/m) h of a counterweight M that
    falls by h: then the stone m has all of its energy M g h.
    """
    # The long arm slopes down to the left, its tip a little above the trough.
    slope = 0.98 * math.asin(height / long)
    half = (long + short) / 2
    beam = Beam(
        "beam",
        beam_density * 2 * half,
        2 * half,
        angle=slope,
        points={"pivot": (long - half, 0.0)},
    ).placed("pivot", ground.pose((0.0, height)))
    weight = RigidBody(
        "counterweight",
        counterweight,
        counterweight * 0.8**2 / 6,
        extent=((-0.4, -0.4), (0.4, -0.4), (0.4, 0.4), (0.0, hanger), (-0.4, 0.4)),
        points={"hook": (0.0, hanger)},
    ).placed("hook", beam.pose("end"))
    tip = height - long * math.sin(slope)
    stone = RigidBody(
        "stone",
        stone_mass,
        0.1 * stone_mass * 0.3**2,
        position=(math.sqrt(sling**2 - tip**2) - long * math.cos(slope), 0.0),
        extent=0.3,
    )
    return Scene(
        bodies=[beam, weight, stone],
        joints=[
            Revolute(beam.at("pivot"), ground.at((0.0, height)), name="pivot"),
            Revolute(weight.at("hook"), beam.at("end"), name="hanger"),
            Distance(stone.at(), beam.at("start"), length=sling, name="sling"),
        ],
        effects=[
            Gravity(),
            Contact(stone.at(), ground.at(), Line(), stiffness=1e6, dissipation=0.5),
        ],
    )
