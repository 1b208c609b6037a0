"""A bouncing ball with friction."""

from ..common.arrays import Number
from ..scene.body.rigid import RigidBody
from ..scene.curve import Line
from ..scene.effect.contact import Contact, Friction
from ..scene.effect.gravity import Gravity
from ..scene.marker import ground
from ..scene.scene import Scene
from .digits import decimal


def bouncing_ball(
    *,
    mass: Number = 0.1,  # [kg]
    radius: float = 0.03,  # [m]
    height: float = 0.3,  # of the lowest point at the start [m]
    speed: Number = 1.5,  # along the floor at the start [m/s]
    friction: Number = 0.1,  # coefficient
    stiffness: Number = 2e6,  # of the contact [N/m^(3/2)]
    dissipation: Number = 0.1,  # of the contact [s/m]
) -> Scene:
    """A ball that does not spin, such as a puck, thrown along a floor that brakes it.

    A bounce at the speed w returns e w, with e ≈ 1 − 2 D w / 3 for small dissipation D (Hunt and
    Crossley, J. Appl. Mech. 42, 1975). By Coulomb's law friction takes μ times the impulse of the
    floor, so each bounce costs the speed along it Δu = μ (1 + e) w, whatever the bounce lasts.
    """
    ball = RigidBody(
        "ball",
        mass,
        0.4 * mass * radius**2,
        position=(0.0, height + radius),
        velocity=(speed, 0.0),
        extent=2 * radius,
    )
    # Through the centre, since friction would turn the ball otherwise.
    floor = Contact(
        ball.at(),
        ground.at((0.0, radius)),
        Line(),
        stiffness=stiffness,
        dissipation=dissipation,
        friction=Friction(friction, creep=0.01),
    )
    return decimal(Scene(bodies=[ball], effects=[Gravity(), floor]))
