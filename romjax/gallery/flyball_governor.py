"""A flyball governor."""

import math

import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Number, namespace, untraced
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.damper import Damper
from ..scene.effect.gravity import Gravity
from ..scene.effect.spring import Spring
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from .digits import decimal, drawn
from .rods import rod, towards

_DENSITY, _EDGE = 3000.0, 0.01  # of the rods [kg/m³], [m]


def flyball_governor(
    *,
    ball: Number = 5.0,  # at the tip of each arm [kg]
    stiffness: Number = 8e5,  # of the couplers [N/m]
    damping: Number = 4e4,  # [N s/m]
    speed: Number = 2 * math.pi,  # at the start [rad/s]
) -> Scene:
    """Two balls on arms that hinge on a spinning shaft, and a slider on it that couplers carry.

    Like problem A05 of the IFToMM library of computational benchmark problems (González, Dopico,
    Lugrís and Cuadrado, "A benchmarking system for MBS simulation software", Multibody Syst. Dyn.
    16, 2006), but not the same: arms and couplers are hinged on the axis of the shaft here, and
    0.05 m off it there, so its published motion is another one. Arms and shaft are 1 m long,
    couplers of 0.5 m from the middle of the arms are stiff springs with dampers, so that the
    problem is stiff. Nothing acts about the shaft: the angular momentum stays.
    """
    top, down = np.array([0.0, 0.0, 1.0]), math.radians(30)
    shaft = rod(
        "shaft", (0.0, 0.0, 0.0), top, _DENSITY * _EDGE**2, _EDGE, angular_velocity=speed * top
    )
    cube = 1000 * _DENSITY * 1e-6
    slider = RigidBody(
        "slider",
        cube,
        (cube * 0.01 / 6,) * 3,
        0.5 * top,
        angular_velocity=speed * top,
        extent=(0.1,) * 3,
    )
    arms = []
    for i, side in enumerate((1.0, -1.0)):
        tip = top + np.array([side * math.cos(down), 0.0, -math.sin(down)])
        arms.append(_arm(f"arm{i + 1}", top, tip, ball, speed))
    y, origin = (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    joints = [Revolute(shaft.at("start"), ground.at(origin), name="bearing")]
    joints += [
        Revolute(towards(arm, "top", y), shaft.at("end", axis=y), name=f"hinge{i + 1}")
        for i, arm in enumerate(arms)
    ]
    guide = Prismatic(slider.at(origin), shaft.at(origin), name="guide")
    couplers = [(arm.at("middle"), slider.at(origin)) for arm in arms]
    return decimal(
        Scene(
            bodies=[shaft, slider, *arms],
            joints=[*joints, guide],
            effects=[
                Gravity((0.0, 0.0, -9.81)),
                *[Spring(a, b, stiffness, rest_length=0.5) for a, b in couplers],
                *[Damper(a, b, damping, along_line=True) for a, b in couplers],
            ],
        )
    )


def _arm(name: str, top: np.ndarray, tip: np.ndarray, ball: Number, speed: Number) -> RigidBody:
    """A rod with a point mass at its tip, its frame in the common centre of mass."""
    bare = rod(name, top, tip, _DENSITY * _EDGE**2, _EDGE)
    own, inertia, ball = untraced(bare.mass, bare.inertia, ball)
    mass = own + ball
    centre = (0.5 * own + ball) / mass  # from the top
    across = own * (centre - 0.5) ** 2 + ball * (1 - centre) ** 2
    position = top + centre * (tip - top)
    spin = np.array([0.0, 0.0, 1.0]) * speed
    line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) - centre * np.array([[0.0, 0.0, 1.0]])
    return RigidBody(
        name,
        mass,
        inertia + across * np.array([1.0, 1.0, 0.0]),
        position=position,
        orientation=bare.orientation,
        velocity=np.cross(spin, position),
        angular_velocity=spin,
        extent=_with_ball(line, 0.08),
        points={"top": line[0], "middle": 0.5 * (line[0] + line[1])},
    )


def _with_ball(line: Float[Array, "2 3"], radius: float) -> Float[Array, "points 3"]:
    """A line with circles in two planes around its end."""
    angle = np.linspace(0.0, 2 * np.pi, 25)
    around = radius * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    parts = [line, line[1:] + around, line[1:] + around[:, [1, 0, 2]], line[1:]]
    outline: Array = drawn(namespace(line).concatenate(parts))
    return outline
