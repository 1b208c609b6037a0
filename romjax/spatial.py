"""What is different in space: `romjax.spatial`, for short r = rj.spatial.

Parts whose formula is the same in the plane and in space are one class: Gravity, Spring, Damper,
Force, Distance. The dimension of a scene is that of its bodies.
"""

from .scene.body.spatial.beam import Beam
from .scene.body.spatial.inertia import SpatialInertia
from .scene.body.spatial.modal import ModalBody
from .scene.body.spatial.rigid import RigidBody
from .scene.effect.spatial.torque import Torque
from .scene.joint.spatial.cylindrical import Cylindrical
from .scene.joint.spatial.planar import Planar
from .scene.joint.spatial.prismatic import Prismatic
from .scene.joint.spatial.revolute import Revolute
from .scene.joint.spatial.spherical import Spherical
from .scene.joint.spatial.universal import Universal
from .scene.joint.spatial.weld import Weld
from .scene.orientation import euler, rotation

__all__ = [
    "Beam",
    "Cylindrical",
    "ModalBody",
    "Planar",
    "Prismatic",
    "Revolute",
    "RigidBody",
    "SpatialInertia",
    "Spherical",
    "Torque",
    "Universal",
    "Weld",
    "euler",
    "rotation",
]
