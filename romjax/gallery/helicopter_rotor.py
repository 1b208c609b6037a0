"""A helicopter's rotor with blades that rotation stiffens."""

import math

import numpy as np

from ..scene.body.spatial.beam import Beam
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.force import Force
from ..scene.joint.revolute import Revolute
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.orientation import rotation
from ..scene.scene import Scene
from ..scene.signal import Step, Sum
from .digits import decimal


def helicopter_rotor(
    blades: int = 3,
    *,
    length: float = 5.0,  # of a blade, from the axis [m]
    mass: float = 20.0,  # [kg]
    EI: tuple[float, float] = (4e3, 4e5),  # against flapping and in the plane [N m²]
    speed: float = 2.5298221281347035,  # of the rotation, 2 √(EI / m L³) [rad/s]
    gust: float = 2.0,  # on the tips, for a moment [N]
) -> Scene:
    """Blades clamped to a hub that turns freely about z; a gust makes them flap.

    Bending pulls the blades inwards (`stiffening`), against which the rotation pulls them out. With
    λ = ω √(m L³/EI) of flapping and η of the speed, λ is tabulated by Wright, Smith, Thresher and
    Wang ("Vibration modes of centrifugally stiffened beams", J. Appl. Mech. 49, 1982), such as
    4.1373 at η = 2; at rest it is 3.5160.
    """
    z = np.array([0.0, 0.0, 1.0])
    hub = RigidBody(
        "hub", 50.0, (20.0, 20.0, 30.0), angular_velocity=speed * z, extent=(0.6, 0.6, 0.2)
    )
    centre = (0.0, 0.0, 0.0)
    joints: list[Revolute | Weld] = [Revolute(hub.at(centre), ground.at(centre), name="mast")]
    bodies, gusts = list[Beam](), list[Force]()
    push = Sum((Step(gust, 0.0, 0.1), Step(-gust, 0.2, 0.1)))
    across = mass * length**2 / 12
    for i in range(blades):
        angle = 2 * math.pi * i / blades
        outwards = np.array([math.cos(angle), math.sin(angle), 0.0])
        blade = Beam(
            f"blade{i + 1}",
            mass,
            length,
            (0.02, across + 0.01, across + 0.01),
            EI=EI,
            bending=(2, 4),
            stiffening=True,
            position=0.5 * length * outwards,
            orientation=rotation(z, angle),
            velocity=0.5 * length * speed * np.cross(z, outwards),
            angular_velocity=speed * z,
        )
        root = hub.at(centre, rotation=rotation(z, angle))
        joints.append(Weld(blade.at("start"), root, name=f"root{i + 1}"))
        gusts.append(Force(blade.at("end"), z, push))
        bodies.append(blade)
    return decimal(Scene(bodies=[hub, *bodies], joints=joints, effects=gusts))
