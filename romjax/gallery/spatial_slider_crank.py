"""A spatial slider crank."""

import numpy as np

from ..common.arrays import Number
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.joint.spatial.spherical import Spherical
from ..scene.joint.spatial.universal import Universal
from ..scene.marker import ground
from ..scene.scene import Scene
from .rods import towards


def spatial_slider_crank(
    *,
    crank_mass: Number = 0.12,  # [kg]
    rod_mass: Number = 0.5,
    slider_mass: Number = 2.0,
    speed: Number = 6.0,  # of the crank at the start [rad/s]
) -> Scene:
    """A crank about x, a rod on a ball joint, and a slider along x on a universal joint of the rod.

    The mechanism of Haug ("Computer Aided Kinematics and Dynamics of Mechanical Systems", 1989,
    pages 396 to 401), of one freedom: crank 0.08 m, rod 0.3 m, bearing at y = 0.1 m, z = 0.12 m.
    The universal joint turns about the slide, and about a normal of rod and slide. At the start the
    crank is upright; by its `speed`, the slider moves at 0.04 m, and the rod turns at
    (0.32, −0.16, 0.08).
    """
    bearing, pin, end = np.array([0, 0.1, 0.12]), np.array([0, 0.1, 0.2]), np.array([0.2, 0, 0])
    slide, along_x = np.array([0.04, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    falling = np.array([0.0, -0.08, 0.0])  # of the pin, by the speed
    crank = RigidBody(
        "crank",
        crank_mass,
        (1e-4, 1e-4, 1e-5),
        position=(bearing + pin) / 2,
        velocity=speed * falling / 2,
        angular_velocity=speed * along_x,
        extent=(0.01, 0.01, 0.08),
        points={"bearing": (0.0, 0.0, -0.04), "pin": (0.0, 0.0, 0.04)},
    )
    # Its y axis is along the rod, its z axis normal to rod and slide.
    way = (pin - end) / 0.3
    normal = np.cross(way, along_x) / np.linalg.norm(np.cross(way, along_x))
    rod = RigidBody(
        "rod",
        rod_mass,
        (4e-3, 4e-4, 4e-3),
        position=(pin + end) / 2,
        orientation=np.stack([np.cross(way, normal), way, normal], axis=1),
        velocity=speed * (falling + slide) / 2,
        angular_velocity=speed * np.array([0.32, -0.16, 0.08]),
        extent=(0.01, 0.3, 0.01),
        points={"pin": (0.0, 0.15, 0.0), "end": (0.0, -0.15, 0.0)},
    )
    slider = RigidBody(
        "slider",
        slider_mass,
        (1e-4, 1e-4, 1e-4),
        end,
        velocity=speed * slide,
        extent=(0.06, 0.04, 0.04),
    )
    middle = (0.0, 0.0, 0.0)
    bearings = towards(crank, "bearing", along_x), ground.at(bearing, axis=along_x)
    guides = slider.at(middle, axis=along_x), ground.at(middle, axis=along_x)
    return Scene(
        bodies=[crank, rod, slider],
        joints=[
            Revolute(*bearings, name="bearing"),
            Spherical(rod.at("pin"), crank.at("pin"), name="pin"),
            Universal(rod.at("end"), slider.at(middle, axis=along_x), name="wrist"),
            Prismatic(*guides, name="slide"),
        ],
        effects=[Gravity((0.0, 0.0, -9.81))],
    )
