"""A four-bar linkage."""

import math

from ..common.arrays import Number
from ..scene.effect.gravity import Gravity
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step
from .linkage import bar, meeting


def four_bar(
    *,
    crank: float = 0.2,  # lengths [m]
    coupler: float = 0.5,
    rocker: float = 0.4,
    base: float = 0.45,  # between the bearings
    density: Number = 2.0,  # mass per length [kg/m]
    turns: float = 2.0,  # of the crank
    duration: Number = 3.0,  # of the turns [s]
) -> Scene:
    """A crank that turns, a coupler, and a rocker that swings.

    By Grashof's condition, shortest + longest ≤ sum of the others, the crank can turn fully. The
    rocker stands still where crank and coupler are in line, stretched or folded: there its angle ψ
    against the base is that of a triangle with the sides base, rocker and coupler ± crank,

        cos ψ = (base² + rocker² − (coupler ± crank)²) / (2 base rocker).

    The crank starts along the base and follows a smooth step, from rest to rest.
    """
    pin, bearing = (crank, 0.0), (base, 0.0)
    knee = meeting(pin, bearing, coupler, rocker)
    bars = [
        bar("crank", (0.0, 0.0), pin, density),
        bar("coupler", pin, knee, density),
        bar("rocker", bearing, knee, density),
    ]
    turning, floating, swinging = bars
    angle = Step(2 * math.pi * turns, 0.0, duration)
    return Scene(
        bodies=bars,
        joints=[
            Revolute(turning.at("start"), ground.at(), name="crank bearing"),
            Revolute(floating.at("start"), turning.at("end"), name="pin"),
            Revolute(swinging.at("end"), floating.at("end"), name="knee"),
            Revolute(swinging.at("start"), ground.at(bearing), name="rocker bearing"),
            PrescribedAngle(turning.at("start"), ground.at(), angle, name="drive"),
        ],
        effects=[Gravity()],
    )
