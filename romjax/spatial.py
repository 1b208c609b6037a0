"""What is different in space: `romjax.spatial`, for short r = rj.spatial.

Parts whose formula is the same in the plane and in space are one class: Gravity, Spring, Damper,
TorsionSpring, TorsionDamper, Motor, Drag, Force, Distance, PointOnLine, FixedAngle, PrescribedAngle,
PrescribedTravel; angles and travels are those about and along the z axes of markers. The dimension of a scene is that of its bodies.
"""

from .scene.body.spatial.rigid import RigidBody
from .scene.effect.spatial.torque import Torque
from .scene.joint.spatial.constant_velocity import ConstantVelocity
from .scene.joint.spatial.cylindrical import Cylindrical
from .scene.joint.spatial.gear import Gear
from .scene.joint.spatial.planar import Planar
from .scene.joint.spatial.point_on_plane import PointOnPlane
from .scene.joint.spatial.prismatic import Prismatic
from .scene.joint.spatial.revolute import Revolute
from .scene.joint.spatial.screw import Screw
from .scene.joint.spatial.spherical import Spherical
from .scene.joint.spatial.universal import Universal
from .scene.joint.spatial.weld import Weld
from .scene.orientation import euler, rotation

__all__ = [
    "ConstantVelocity",
    "Cylindrical",
    "Gear",
    "Planar",
    "PointOnPlane",
    "Prismatic",
    "Revolute",
    "RigidBody",
    "Screw",
    "Spherical",
    "Torque",
    "Universal",
    "Weld",
    "euler",
    "rotation",
]
