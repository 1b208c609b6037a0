"""A crank drive whose connecting rod is a mesh."""

from pathlib import Path

import numpy as np

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.modal import ModalBody
from ..scene.body.rigid import RigidBody
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Ramp

MESH = str(Path(__file__).parent / "files" / "connecting-rod")
LENGTH = 0.15  # of the rod, between its eyes [m]


def connecting_rod(
    *,
    crank: float = 0.045,  # radius of the crank [m]
    speed: float = 200.0,  # [rad/s]
    piston: Number = 0.4,  # [kg]
    modes: int = 2,  # of the rod, beside the static ones of its eyes
) -> Scene:
    """A crank that turns steadily, a steel rod of finite elements in plane stress, and a piston.

    Nodes and matrices are files, as any finite-element program writes them (`ModalBody.of_mesh`).
    Craig–Bampton's static modes of both eyes and two modes between them stand for some six hundred
    nodes. At the outer dead point the rod must stop the piston, whose acceleration is
    r Ω² (1 + r/l) where the rod is stiff.
    """
    shaft = Beam(
        "crank",
        0.3,
        crank,
        velocity=(0.0, speed * crank / 2),
        angular_velocity=speed,
    ).placed("start", ground.pose())
    with np.load(MESH + ".npz") as mesh:
        rod = ModalBody.of_mesh(
            "rod",
            MESH + "-stiffness.npz",
            MESH + "-mass.npz",
            mesh["nodes"],
            {"crank": mesh["crank"], "piston": mesh["piston"]},
            modes=modes,
            damping=0.02,
            velocity=(0.0, speed * crank),
            angular_velocity=-speed * crank / LENGTH,
        ).placed("crank", shaft.pose("end"))
    head = RigidBody("piston", piston, 1e-4, extent=(0.05, 0.07))
    head = head.placed((0.0, 0.0), rod.pose("piston"))
    return Scene(
        bodies=[shaft, rod, head],
        joints=[
            Revolute(shaft.at("start"), ground.at(), name="crank bearing"),
            Revolute(rod.at("crank"), shaft.at("end"), name="big eye"),
            Revolute(rod.at("piston"), head.at(), name="small eye"),
            Prismatic(head.at(), ground.at(), name="cylinder"),
            PrescribedAngle(shaft.at("start"), ground.at(), Ramp(speed), name="drive"),
        ],
    )
