"""The rear axle of a vehicle on a bumpy road."""

import math

from ..common.arrays import Number
from ..scene.body.rigid import RigidBody
from ..scene.effect.base import AbstractEffect
from ..scene.effect.bushing import Bushing
from ..scene.effect.damper import Damper
from ..scene.effect.gravity import Gravity
from ..scene.effect.spring import Spring
from ..scene.joint.base import AbstractJoint
from ..scene.joint.distance import Distance
from ..scene.joint.prescribed import PrescribedTravel
from ..scene.joint.prismatic import Prismatic
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step, Sum
from .digits import decimal

GRAVITY = 9.81  # [m/s²]
# What pictures show: a box with a bracket for the rod, and a bar between two wheels.
BODY = (
    *((-0.75, -0.25), (-0.65, -0.25), (-0.6, -0.65), (-0.55, -0.25)),
    *((0.75, -0.25), (0.75, 0.25), (-0.75, 0.25)),
)
AXLE = (
    *((-0.85, -0.3), (-0.65, -0.3), (-0.65, -0.05), (0.65, -0.05), (0.65, -0.3), (0.85, -0.3)),
    *((0.85, 0.3), (0.65, 0.3), (0.65, 0.05), (-0.65, 0.05), (-0.65, 0.3), (-0.85, 0.3)),
)


def vehicle_axle(
    *,
    body_mass: Number = 500.0,  # half of the vehicle [kg]
    body_inertia: Number = 180.0,  # in roll [kg m²]
    axle_mass: Number = 80.0,  # with both wheels [kg]
    axle_inertia: Number = 30.0,  # [kg m²]
    stiffness: Number = 18e3,  # of each spring [N/m]
    damping: Number = 1200.0,  # of each damper [N s/m]
    tyre: Number = 180e3,  # stiffness of each tyre, up and to the side [N/m]
    bump: Number = 0.06,  # height [m]
    duration: Number = 0.12,  # of the way up or down a bump [s]
) -> Scene:
    """A body on two springs and dampers over a rigid axle on two tyres, seen from behind.

    A Panhard rod guides the axle to the side; the road rises and falls below the left tyre, then
    below both.

    From static equilibrium. About it, with masses M and m, springs k and dampers d, tyres c with a
    damping e, up and down of body a and axle b follow M s² a + 2 (d s + k)(a − b) = 0 and
    m s² b + 2 (d s + k)(b − a) + 2 (e s + c) b = 0: bounce at 1.30 Hz with 25 % of critical
    damping, and wheel hop at 11.1 Hz with 28 %.
    """
    level, road_level = 0.3, 0.0  # of the wheels' centres and of the road [m]
    weight = GRAVITY * body_mass / 2  # on each spring [N]
    load = weight + GRAVITY * axle_mass / 2  # on each tyre [N]
    body = RigidBody("body", body_mass, body_inertia, position=(0.0, 0.9), extent=BODY)
    axle = RigidBody("axle", axle_mass, axle_inertia, position=(0.0, level), extent=AXLE)
    left, right = (
        RigidBody(f"{side} road", 1.0, 0.1, position=(x, road_level), extent=(0.4, 0.03))
        for side, x in (("left", -0.75), ("right", 0.75))
    )
    first = [Step(bump, 0.2, duration), Step(-1.0 * bump, 0.2 + duration, duration)]
    second = [Step(bump, 1.2, duration), Step(-1.0 * bump, 1.2 + duration, duration)]
    joints: list[AbstractJoint] = [
        Distance(axle.at((0.6, 0.0)), body.at((-0.6, level - 0.9)), length=1.2, name="Panhard rod")
    ]
    effects: list[AbstractEffect] = [Gravity((0.0, -GRAVITY))]
    for x, road, bumps in ((-0.75, left, first + second), (0.75, right, second)):
        up = ground.at((x, road_level), angle=math.pi / 2)
        joints += [
            Prismatic(road.at(), up, value=-math.pi / 2, name=f"{road.name} guide"),
            PrescribedTravel(road.at(), up, Sum(tuple(bumps)), name=f"{road.name} bumps"),
        ]
        # What the load presses together, springs and tyres have more at the start.
        patch = road.at((0.0, level + load / tyre))
        effects.append(Bushing(axle.at((x, 0.0)), patch, (tyre, tyre, 0.0), (300.0, 300.0, 0.0)))
    for x in (-0.5, 0.5):
        lower, upper = axle.at((x, 0.0)), body.at((x, -0.2))
        length = 0.4 + weight / stiffness
        effects += [
            Spring(lower, upper, stiffness=stiffness, rest_length=length),
            Damper(lower, upper, damping=damping, along_line=True),
        ]
    return decimal(Scene(bodies=[body, axle, left, right], joints=joints, effects=effects))
