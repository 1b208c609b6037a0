"""The chapter's example: a cart on a diagonal rail with a flexible pendulum."""

import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.effect.damper import Damper
from ..scene.effect.force import Force
from ..scene.effect.spring import Spring
from ..scene.joint.fixed_angle import FixedAngle
from ..scene.joint.point_on_line import PointOnLine
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Sine


def cart_pendulum(
    *,
    cart_mass: Number = 1.0,  # m_c [kg]
    pendulum_mass: Number = 0.004,  # m_p [kg]
    length: float = 0.8,  # l_p [m]
    stiffness: Number = 100.0,  # c_c [N/m], in x and in y
    damping: Number = 0.1,  # d_c [N s/m], in x and in y
    force: Number = 10.0,  # amplitude [N], along the rail
    frequency: Number = 10.0,  # of the force [Hz]
    f1: Number = 16.0,  # first bending frequency, free-free [Hz]
    f2: Number = 1000.0,  # second bending frequency, free-free [Hz]
    cart_inertia: Number = 0.01,  # J_c [kg m²]
) -> Scene:
    """Cart on a rail along x = y, sprung and damped to the ground, pendulum hinged to its centre.

    Numbers of the chapter's section 39.4.1. What the chapter leaves out is fixed here: the cart's
    inertia, the pendulum's J = m l²/12, f₂ = 1000 Hz ("> 1 kHz"), a force A sin(2πft) without
    phase, springs relaxed at the origin, no gravity, and a start at rest with the pendulum
    hanging straight down. Coordinates x, y, φ of the cart, then x, y, φ, q₁, q₂ of the pendulum;
    its axis is the local y axis and both modes are ±2/√m at the hinge. Constraints in the order of
    equations 39.14 to 39.16: rail, angle of the cart, hinge.

    A uniform beam with f₁ = 16 Hz would have f₂ = 44 Hz: the chapter's pair fits no beam, so the
    frequencies are given, not EI.
    """
    cart = RigidBody("cart", mass=cart_mass, inertia=cart_inertia)
    pendulum = Beam(
        "pendulum",
        mass=pendulum_mass,
        length=length,
        frequencies=[f1, f2],
        axis="y",
        position=(0.0, -length / 2),
    )
    rail = ground.at((0.0, 0.0), angle=math.pi / 4)
    return Scene(
        bodies=[cart, pendulum],
        joints=[
            PointOnLine(cart.at(), rail, name="rail"),
            FixedAngle(cart.at(), ground.at(), name="cart angle"),
            Revolute(cart.at(), pendulum.at((0.0, length / 2)), name="hinge"),
        ],
        effects=[
            Spring(cart.at(), ground.at(), stiffness=stiffness),
            Damper(cart.at(), ground.at(), damping=damping),
            Force(cart.at(), direction=(1.0, 1.0), signal=Sine(force, frequency)),
        ],
    )
