"""Classes that differ in space: `romjax.spatial`, for short r = rj.spatial.

Parts that the plane has too are one class: Gravity, Spring, Damper, TorsionSpring, TorsionDamper,
Motor, Drag, Force, Torque, Bushing, Revolute, Prismatic, Weld, Gear, Distance, PointOnLine,
PointOnCurve, FixedAngle, PrescribedAngle, PrescribedTravel, PrescribedDistance. In space their
angles are those about the z axes of markers, and their lines and travels those along them. The
dimension of a scene is that of its bodies.
"""

from .scene.body.spatial.beam import Beam as Beam
from .scene.body.spatial.inertia import SpatialInertia as SpatialInertia
from .scene.body.spatial.modal import ModalBody as ModalBody
from .scene.body.spatial.rigid import RigidBody as RigidBody
from .scene.body.spatial.rod import Rod as Rod
from .scene.effect.bushing import Bushing as Bushing
from .scene.effect.joint_inertia import JointInertia as JointInertia
from .scene.effect.spatial.contact import Contact as Contact
from .scene.effect.torque import Torque as Torque
from .scene.joint.gear import Gear as Gear
from .scene.joint.point_on_curve import PointOnCurve as PointOnCurve
from .scene.joint.prismatic import Prismatic as Prismatic
from .scene.joint.revolute import Revolute as Revolute
from .scene.joint.spatial.aligned import ParallelAxes as ParallelAxes
from .scene.joint.spatial.aligned import RightAngle as RightAngle
from .scene.joint.spatial.aligned import Untwisted as Untwisted
from .scene.joint.spatial.constant_velocity import ConstantVelocity as ConstantVelocity
from .scene.joint.spatial.cylindrical import Cylindrical as Cylindrical
from .scene.joint.spatial.planar import Planar as Planar
from .scene.joint.spatial.point_on_plane import PointOnPlane as PointOnPlane
from .scene.joint.spatial.rolling import RollingBall as RollingBall
from .scene.joint.spatial.rolling import RollingDisc as RollingDisc
from .scene.joint.spatial.screw import Screw as Screw
from .scene.joint.spatial.spherical import Spherical as Spherical
from .scene.joint.spatial.universal import Universal as Universal
from .scene.joint.weld import Weld as Weld
from .scene.orientation import euler as euler
from .scene.orientation import rotation as rotation
from .scene.space_curve import AbstractSpaceCurve as AbstractSpaceCurve
from .scene.space_curve import Helix as Helix
from .scene.space_curve import SpacePolynomial as SpacePolynomial
from .scene.surface import AbstractSurface as AbstractSurface
from .scene.surface import Capsule as Capsule
from .scene.surface import Cylinder as Cylinder
from .scene.surface import Plane as Plane
from .scene.surface import Sphere as Sphere
