"""A rotor on elastic bearings."""

import math

import numpy as np

from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.spring import Spring
from ..scene.marker import ground
from ..scene.scene import Scene
from .digits import decimal, drawn


def rotor(
    *,
    mass: float = 2.0,  # [kg]
    moments: tuple[float, float] = (0.02, 0.03),  # across and along the shaft [kg m²]
    span: float = 0.4,  # between the bearings [m]
    stiffness: float = 2e4,  # of each bearing, in all directions [N/m]
    speed: float = 200.0,  # [rad/s]
    unbalance: float = 1e-3,  # from the shaft to the centre of mass [m]
    tilt: float = 0.02,  # of the shaft at the start [rad]
) -> Scene:
    """A disc on a stiff shaft in two soft bearings, out of balance and tilted at the start.

    The unbalance e bends the way of the shaft to a circle of the radius e Ω² / (ω₀² − Ω²) with
    ω₀² = 2 k / m, on the side of the heavy spot below the critical speed ω₀, and on the other side
    above it; the scene starts on it. The shaft whirls at the two rates that a small tilt has,

        J_t ω² − J_p Ω ω − ½ k l² = 0,

    one forwards and one backwards: spinning drives them apart (Genta, "Dynamics of Rotating
    Systems", 2005, chapter 2).
    """
    across, along = moments
    radius = unbalance * speed**2 / (2 * stiffness / mass - speed**2)  # of the shaft
    spin = np.array([0.0, speed * math.sin(tilt), speed * math.cos(tilt)])
    body = RigidBody(
        "rotor",
        mass,
        (across, across, along),
        position=(radius + unbalance, 0.0, 0.0),
        orientation=(math.cos(tilt / 2), -math.sin(tilt / 2), 0.0, 0.0),
        velocity=(0.0, speed * (radius + unbalance), 0.0),
        angular_velocity=spin,
        extent=_disc(span, 0.15, unbalance),
        points={
            side: (-unbalance, 0.0, z) for side, z in (("lower", -span / 2), ("upper", span / 2))
        },
    )
    bearings = [
        Spring(body.at(side), ground.at((0.0, 0.0, z)), stiffness)
        for side, z in (("lower", -span / 2), ("upper", span / 2))
    ]
    return decimal(Scene(bodies=[body], effects=bearings))


def _disc(span: float, radius: float, unbalance: float) -> np.ndarray:
    """The shaft, and around it the rim with its spokes."""
    angle = np.linspace(0.0, 2 * np.pi, 33)
    rim = drawn(radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))
    centre = np.zeros((1, 3))
    spokes = [np.concatenate([centre, rim[k : k + 9], centre]) for k in (0, 8, 16, 24)]
    shaft = np.array([[0.0, 0.0, -span / 2], [0.0, 0.0, span / 2], [0.0, 0.0, 0.0]])
    path: np.ndarray = np.concatenate([shaft, *spokes]) - np.array([unbalance, 0.0, 0.0])
    return path
