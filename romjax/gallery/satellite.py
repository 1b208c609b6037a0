"""A satellite with flexible panels."""

import numpy as np

from ..common.arrays import Number
from ..scene.body.spatial.beam import Beam
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.torque import Torque
from ..scene.joint.weld import Weld
from ..scene.orientation import rotation
from ..scene.scene import Scene
from ..scene.signal import Step, Sum


def satellite(
    *,
    mass: Number = 200.0,  # of the hub, a cube of 1 m [kg]
    panel_mass: float = 10.0,  # of each panel [kg]
    span: float = 4.0,  # of each panel [m]
    EI: Number = 200.0,  # of a panel, against bending out of its plane [N m²]
    torque: Number = 10.0,  # of the thrusters about z [N m]
) -> Scene:
    """A cube in free flight with two panels along y, which thrusters set in rotation about z.

    The panels are upright, so that the rotation bends them where they are soft, and they swing on
    against the hub. The angular momentum stays at the torque times its time, 1 s.
    """
    hub = RigidBody("hub", mass, (mass / 6,) * 3, extent=(1.0, 1.0, 1.0))
    panels, joints = list[Beam](), list[Weld]()
    width, along = 1.0, panel_mass * span**2 / 12
    across = panel_mass * width**2 / 12
    for i, side in enumerate((1.0, -1.0)):
        turn = rotation((0.0, 0.0, 1.0), side * np.pi / 2)
        panel = Beam(
            f"panel{i + 1}",
            panel_mass,
            span,
            (across, along + across, along),
            EI=EI * np.array([400.0, 1.0]),
            bending=(3, 1),
            GJ=2.0 * EI,
            torsion=1,
            damping=0.1,
            position=(0.0, side * (0.5 + 0.5 * span), 0.0),
            orientation=turn,
        )
        root = hub.at((0.0, 0.5 * side, 0.0), rotation=turn)
        joints.append(Weld(panel.at("start"), root, name=f"root{i + 1}"))
        panels.append(panel)
    push = Sum((Step(torque, 0.0, 0.2), Step(-1.0 * torque, 1.0, 0.2)))
    thrusters = Torque(hub.at((0.0, 0.0, 0.0)), push, (0.0, 0.0, 1.0))
    return Scene(bodies=[hub, *panels], joints=joints, effects=[thrusters])
