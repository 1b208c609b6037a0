"""A double pendulum, which is chaotic."""

import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.effect.gravity import Gravity
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene


def double_pendulum(
    *,
    length: Number = 0.5,  # of each bar [m]
    mass: Number = 1.0,  # of each bar [kg]
    angle: Number = 2.2,  # at which both bars start, from hanging down [rad]
) -> Scene:
    """Two equal uniform bars, hinged end to end from the origin, released in line at rest.

    In the angles θ of both bars, with m, l and J = m l²/12,

        T = ½ m l² (4/3 θ₁'² + 1/3 θ₂'² + θ₁' θ₂' cos(θ₁ − θ₂)),
        V = −½ m g l (3 cos θ₁ + cos θ₂).

    Nothing dissipates, so T + V stays. From high up the motion is chaotic: neighbouring starts part
    exponentially, by six powers of ten in some ten seconds.
    """
    upper = Beam("upper", mass, length, angle=angle - math.pi / 2)
    upper = upper.placed("start", ground.pose())
    lower = Beam("lower", mass, length, angle=upper.angle).placed("start", upper.pose("end"))
    return Scene(
        bodies=[upper, lower],
        joints=[
            Revolute(upper.at("start"), ground.at(), name="shoulder"),
            Revolute(lower.at("start"), upper.at("end"), name="elbow"),
        ],
        effects=[Gravity()],
    )
