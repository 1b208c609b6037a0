"""A robot arm in space with flexible links."""

import numpy as np

from ..common.arrays import Number
from ..scene.body.spatial.beam import Beam
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.effect.motor import Motor
from ..scene.joint.revolute import Revolute
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step
from .digits import decimal

_UP, _LIFT = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)  # axes of the drives


def spatial_arm(
    *,
    lengths: tuple[float, float] = (0.8, 0.6),  # of upper arm and forearm [m]
    masses: tuple[Number, Number] = (3.0, 2.0),  # [kg]
    EI: Number = 900.0,  # of the upper arm, and two thirds of it of the forearm [N m²]
    load: Number = 1.5,  # in the grip [kg]
    proportional: Number = 900.0,  # of the first drives, and a third of it of the last [N m/rad]
    derivative: Number = 120.0,  # [N m s/rad]
) -> Scene:
    """A column that turns, an upper arm and a forearm of beams that bend and twist, and a load.

    The arm is level along x at the start. Its drives turn the column by 1.2 rad, lift the upper arm
    by 0.6 rad and the forearm by 0.5 rad more; without an integral part those that lift stop short,
    where P (target − θ) of each carries the weight of all that is beyond it.
    """
    column = RigidBody("column", 5.0, (0.05, 0.05, 0.05), (0, 0, 0.2), extent=(0.15, 0.15, 0.4))
    bodies: list[Beam | RigidBody] = [column]
    foot, yaw = column.at((0.0, 0.0, -0.2)), ground.at((0.0, 0.0, 0.0))
    joints: list[Revolute | Weld] = [Revolute(foot, yaw, name="yaw")]
    drives = [Motor(foot, yaw, Step(1.2, 0.0, 1.0), proportional, derivative)]
    wrist, reached = column.at((0.0, 0.0, 0.2), axis=_LIFT), column.pose((0.0, 0.0, 0.2))
    for i, (length, mass) in enumerate(zip(lengths, masses, strict=True)):
        section = np.array([0.05**2 / 6, 0.05**2 / 12, 0.05**2 / 12])
        link = Beam(
            ("upper", "fore")[i],
            mass,
            length,
            mass * (np.array([0.0, 1.0, 1.0]) * length**2 / 12 + section),
            EI=EI / (1 + 0.5 * i),
            bending=2,
            GJ=0.5 * EI,
            torsion=1,
            damping=0.02,
        ).placed("start", reached)
        foot = link.at("start", axis=_LIFT)
        joints.append(Revolute(foot, wrist, name=("shoulder", "elbow")[i]))
        share = 1 / (1 + 2 * i)
        target = Step((0.6, 0.5)[i], 0.2, 1.0)
        drives.append(Motor(foot, wrist, target, proportional * share, derivative * share))
        bodies.append(link)
        wrist, reached = link.at("end", axis=_LIFT), link.pose("end")
    grip = RigidBody("load", load, (2e-3,) * 3, extent=(0.1,) * 3).placed((0.0, 0.0, 0.0), reached)
    joints.append(Weld(grip.at((0.0, 0.0, 0.0), axis=_LIFT), wrist, name="grip"))
    effects = [Gravity((0.0, 0.0, -9.81)), *drives]
    return decimal(Scene(bodies=[*bodies, grip], joints=joints, effects=effects))
