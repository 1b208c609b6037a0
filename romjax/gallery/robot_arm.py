"""A robot arm with flexible links."""

import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.effect.motor import Motor
from ..scene.joint.base import AbstractJoint
from ..scene.joint.revolute import Revolute
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step
from .digits import decimal


def robot_arm(
    *,
    length: float = 0.5,  # of each link [m]
    masses: tuple[Number, Number, Number] = (2.0, 1.5, 1.0),  # of the links [kg]
    stiffness: Number = 800.0,  # EI of the first link, and less of the others [N m²]
    load: Number = 0.5,  # in the grip [kg]
    proportional: Number = 400.0,  # of the first drive, and less of the others [N m/rad]
    derivative: Number = 50.0,  # [N m s/rad]
) -> Scene:
    """Three flexible links on drives lift a load, from hanging down to above the horizontal.

    Clamped-free modes follow the drives at the lower ends of the links. The drives are controlled
    by angle and rate, each against the link before; without an integral part they stop below their
    targets, where the torque P (target − θ) of each carries the weight of all that is beyond it.
    """
    links, joints, drives = list[Beam](), list[AbstractJoint](), list[Motor]()
    # Angles count from hanging down.
    wrist, reached = ground.at(angle=-math.pi / 2), ground.pose()
    for i, (mass, target) in enumerate(zip(masses, (2.4, -0.9, -0.6), strict=True)):
        link = Beam(
            f"link{i + 1}",
            mass,
            length,
            EI=stiffness / (i + 1),
            modes=2,
            shapes="clamped-free",
            damping=0.02,
            angle=-math.pi / 2,
        ).placed("start", reached)
        turn, share = Step(target, 0.1 + 0.2 * i, 0.8), 1 / (i + 1)
        joints.append(Revolute(link.at("start"), wrist, name=f"joint{i + 1}"))
        drives.append(
            Motor(link.at("start"), wrist, turn, proportional * share, derivative * share)
        )
        links.append(link)
        wrist, reached = link.at("end"), link.pose("end")
    grip = RigidBody("load", load, 1e-3, angle=-math.pi / 2, extent=0.08)
    grip = grip.placed((0.0, 0.0), reached)
    joints.append(Weld(grip.at(), wrist, name="grip"))
    return decimal(Scene(bodies=[*links, grip], joints=joints, effects=[Gravity(), *drives]))
