"""What is different in space: `romjax.spatial`, for short r = rj.spatial.

Parts whose formula is the same in the plane and in space are one class: Gravity, Spring, Damper,
TorsionSpring, TorsionDamper, Motor, Drag, Force, Distance, PointOnLine, FixedAngle,
PrescribedAngle, PrescribedTravel. In space their angles are those about the z axes of markers, and
their lines and travels those along them. The dimension of a scene is that of its bodies.
"""

from .scene.body.spatial.rigid import RigidBody
from .scene.effect.spatial.bushing import Bushing
from .scene.effect.spatial.contact import Contact
from .scene.effect.spatial.torque import Torque
from .scene.joint.spatial.constant_velocity import ConstantVelocity
from .scene.joint.spatial.cylindrical import Cylindrical
from .scene.joint.spatial.gear import Gear
from .scene.joint.spatial.planar import Planar
from .scene.joint.spatial.point_on_curve import PointOnCurve
from .scene.joint.spatial.point_on_plane import PointOnPlane
from .scene.joint.spatial.prismatic import Prismatic
from .scene.joint.spatial.revolute import Revolute
from .scene.joint.spatial.screw import Screw
from .scene.joint.spatial.spherical import Spherical
from .scene.joint.spatial.universal import Universal
from .scene.joint.spatial.weld import Weld
from .scene.orientation import euler, rotation
from .scene.space_curve import AbstractSpaceCurve, Helix, SpacePolynomial
from .scene.surface import AbstractSurface, Cylinder, Plane, Sphere

__all__ = [
    "AbstractSpaceCurve",
    "AbstractSurface",
    "Bushing",
    "ConstantVelocity",
    "Contact",
    "Cylinder",
    "Cylindrical",
    "Gear",
    "Helix",
    "Planar",
    "Plane",
    "PointOnCurve",
    "PointOnPlane",
    "Prismatic",
    "Revolute",
    "RigidBody",
    "Screw",
    "SpacePolynomial",
    "Sphere",
    "Spherical",
    "Torque",
    "Universal",
    "Weld",
    "euler",
    "rotation",
]
