"""A chain of ball joints."""

import numpy as np

from ..common.arrays import Number, Vector
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.joint.spatial.spherical import Spherical
from ..scene.marker import ground
from ..scene.scene import Scene


def ball_chain(
    bars: int = 8,
    *,
    mass: Number = 1.0,  # of each bar [kg]
    moments: Vector = (0.02, 0.08, 0.09),  # [kg m²]
    spin: tuple[float, float, float] = (2.0, 0.0, 1.0),  # of the straight chain [rad/s]
) -> Scene:
    """Bars of 1 m on ball joints, level along x from the origin, spinning as one at the start."""
    bodies = []
    for i in range(bars):
        middle = np.array([i + 0.5, 0.0, 0.0])
        bodies.append(
            RigidBody(
                f"bar{i + 1}",
                mass,
                moments,
                position=middle,
                velocity=np.cross(spin, middle),
                angular_velocity=spin,
                extent=(1.0, 0.12, 0.06),
                points={"start": (-0.5, 0.0, 0.0), "end": (0.5, 0.0, 0.0)},
            )
        )
    ends = [ground.at((0.0, 0.0, 0.0)), *[body.at("end") for body in bodies]]
    joints = [
        Spherical(body.at("start"), end, name=f"joint{i + 1}")
        for i, (body, end) in enumerate(zip(bodies, ends, strict=False))
    ]
    return Scene(bodies=bodies, joints=joints, effects=[Gravity((0.0, 0.0, -9.81))])
