"""A walking linkage: two legs of Theo Jansen's kind on one crank."""

import math
from collections.abc import Mapping

from ..common.arrays import Number
from ..scene.body.base import AbstractBody
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.joint.base import AbstractJoint
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.revolute import Revolute
from ..scene.marker import Marker, ground
from ..scene.scene import Scene
from ..scene.signal import Step
from .linkage import Point, bar, meeting, triangle


def jansen(
    *,
    crank: float = 0.15,  # [m]
    turns: float = 2.0,  # of the crank
    duration: Number = 4.0,  # of the turns [s]
    density: Number = 1.0,  # of bars [kg/m], and of triangles [kg/m²]
) -> Scene:
    """A crank between two legs of seven points each, held by a frame that stands still.

    Topology of Jansen's leg (T. Jansen, "The Great Pretender", 2007), lengths rounded to full
    centimetres. Each leg has 6 bodies and closes 3 loops, so 13 bodies move with one freedom, which
    a drive takes. For half a turn a foot stays within 3 % of its stride on one level, and returns
    above it; both legs do the same, mirrored, half a turn apart.
    """
    shaft = bar("crank", (0.0, 0.0), (crank, 0.0), density)
    angle = Step(2 * math.pi * turns, 0.0, duration)
    bodies: list[AbstractBody] = [shaft]
    joints: list[AbstractJoint] = [
        Revolute(shaft.at("start"), ground.at(), name="crank bearing"),
        PrescribedAngle(shaft.at("start"), ground.at(), angle, name="drive"),
    ]
    for side, mirror in (("left", 1), ("right", -1)):
        # The right leg is the left one in a mirror, in which the crank points the other way.
        points = {
            name: (mirror * x, y) for name, (x, y) in _left_leg((mirror * crank, 0.0)).items()
        }
        parts, hinges = _leg(side, points, shaft.at("end"), density)
        bodies += parts
        joints += hinges
    return Scene(bodies=bodies, joints=joints, effects=[Gravity()])


def _left_leg(pin: Point) -> dict[str, Point]:
    """Return the points of the left leg [m]."""
    bearing = (-0.38, -0.08)
    top, hip = meeting(bearing, pin, 0.42, 0.50), meeting(pin, bearing, 0.62, 0.39)
    back = meeting(bearing, top, 0.40, 0.56)
    knee = meeting(hip, back, 0.37, 0.39)
    foot = meeting(hip, knee, 0.49, 0.66)
    names = ("pin", "bearing", "top", "back", "hip", "knee", "foot")
    return dict(zip(names, (pin, bearing, top, back, hip, knee, foot), strict=True))


def _leg(
    side: str, at: Mapping[str, Point], pin: Marker, density: Number
) -> tuple[list[AbstractBody], list[Revolute]]:
    """The six bodies of a leg, and its nine hinges."""

    def link(name: str, start: str, end: str) -> Beam:
        return bar(f"{side} {name}", at[start], at[end], density)

    def plate(name: str, *corners: str) -> RigidBody:
        return triangle(f"{side} {name}", {corner: at[corner] for corner in corners}, density)

    lifter, pusher = link("lifter", "pin", "top"), link("pusher", "pin", "hip")
    guide, strut = link("guide", "bearing", "hip"), link("strut", "back", "knee")
    thigh, shank = plate("thigh", "bearing", "top", "back"), plate("shank", "hip", "knee", "foot")
    pairs = [
        (lifter.at("start"), pin),
        (pusher.at("start"), pin),
        (thigh.at("top"), lifter.at("end")),
        (thigh.at("bearing"), ground.at(at["bearing"])),
        (guide.at("start"), ground.at(at["bearing"])),
        (guide.at("end"), pusher.at("end")),
        (shank.at("hip"), pusher.at("end")),
        (strut.at("start"), thigh.at("back")),
        (strut.at("end"), shank.at("knee")),
    ]
    bodies = [lifter, pusher, guide, strut, thigh, shank]
    return bodies, [Revolute(a, b) for a, b in pairs]
