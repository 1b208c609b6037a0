"""A flywheel with flexible spokes."""

import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.effect.torque import Torque
from ..scene.joint.base import AbstractJoint
from ..scene.joint.point_on_line import PointOnLine
from ..scene.joint.revolute import Revolute
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step, Sum
from .digits import decimal


def flywheel(
    spokes: int = 4,
    *,
    hub: float = 0.1,  # radius of the hub [m]
    rim: float = 0.3,  # and of the rim
    hub_mass: Number = 15.0,  # [kg]
    rim_mass: Number = 10.0,  # [kg]
    spoke_mass: Number = 0.01,  # of each spoke [kg]
    EI: Number = 5.0,  # of each spoke [N m²]
    torque: Number = 40.0,  # on the hub [N m]
) -> Scene:
    """A hub that a torque turns, and a rim on spokes that bend; the torque is taken away at once.

    Spokes are clamped in the hub, and their ends slide along grooves of the rim, so that only their
    bending holds it. Turned by θ against the hub, the rim of radius R bends each of the n by R θ at
    its end, which gives the stiffness k = 3 n EI R² / l³. With light spokes the wheel vibrates at
    ω² = k (1/J_hub + 1/J_rim).
    """
    angles = [2 * math.pi * i / spokes for i in range(spokes)]
    feet = {
        # Zeros of right angles, without a sign.
        f"foot{i + 1}": tuple(hub * (round(f(angle), 15) + 0.0) for f in (math.cos, math.sin))
        for i, angle in enumerate(angles)
    }
    core = RigidBody("hub", hub_mass, hub_mass * hub**2 / 2, extent=2 * hub, points=feet)
    ring = RigidBody("rim", rim_mass, rim_mass * rim**2, extent=2 * rim)
    joints: list[AbstractJoint] = [Revolute(core.at(), ground.at(), name="bearing")]
    beams = []
    for i, (foot, angle) in enumerate(zip(feet, angles, strict=True)):
        beam = Beam(
            f"spoke{i + 1}",
            spoke_mass,
            decimal(rim - hub),
            EI=EI,
            modes=3,
            shapes="clamped-free",
            damping=0.01,
            angle=angle,
        ).placed("start", core.pose(foot))
        joints += [
            Weld(beam.at("start"), core.at(foot, angle)),
            PointOnLine(beam.at("end"), ring.at((0.0, 0.0), angle)),
        ]
        beams.append(beam)
    push = Sum((Step(torque, 0.0, 0.01), Step(-1.0 * torque, 0.2, 0.01)))
    return decimal(
        Scene(bodies=[core, ring, *beams], joints=joints, effects=[Torque(core.at(), push)])
    )
