"""Simeon's slider crank with a flexible rod."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..common.arrays import Number, as_array
from ..scene.body.inertia import Inertia
from ..scene.body.modal import ModalBody
from ..scene.body.rigid import RigidBody
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Ramp
from .digits import decimal

PI = 3.1415927  # as published: the exact one changes the seventh digit of the first mode


def slider_crank(
    *,
    crank: float = 0.15,  # lengths [m]
    rod: float = 0.30,
    side: float = 0.008,  # of the rod's square section [m]
    density: float = 7870.0,  # of the rod [kg/m³]
    modulus: Number = 0.20e12,  # [Pa]
    slider_mass: Number = 0.075552,  # [kg]
    speed: float = 150.0,  # of the crank [rad/s]
) -> Scene:
    """A crank that turns steadily, an elastic rod, and a slider.

    B. Simeon, "Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs",
    Mathematical Modelling of Systems 2 (1996); "crank" of the IVP test set. The rod's frame sits at
    the crank. It bends as two sines and is stretched by two quadratic elements, with the amplitudes
    of the middle and of the end. The start is the published one, near to smooth motion. At 0.1 s,
    after 2.4 turns, the rod is at −0.33117349883 rad, the slider at 0.16973733284 m, and the sines
    are 1.89319290e-4 m and 2.37575125e-5 m.
    """
    stretch = (0.103339863e-4, 0.169327969e-4)  # of the middle and of the end at the start [m]
    end = rod + stretch[1]
    body = ModalBody(
        "rod",
        *_rod(rod, side, density, modulus),
        ports=("crank", "slider"),
        position=(crank, 0.0),
        velocity=(0.0, crank * speed),
        angular_velocity=-crank * speed / end,
        amplitudes=(0.0, 0.0, *stretch),
        rates=(0.444896105, 0.463434311e-2, -0.178591076e-5, -0.268938672e-5),
    )
    shaft = RigidBody(
        "crank",
        0.36,
        0.002727,
        angular_velocity=speed,
        extent=(2 * crank, 0.04),
        points={"pin": (crank, 0.0)},
    )
    slider = RigidBody(
        "slider",
        slider_mass,
        1e-3,
        position=(crank + end, 0.0),
        velocity=(body.rates[3], 0.0),
        extent=(0.06, 0.04),
    )
    return decimal(
        Scene(
            bodies=[shaft, body, slider],
            joints=[
                Revolute(shaft.at(), ground.at(), name="bearing"),
                PrescribedAngle(shaft.at(), ground.at(), Ramp(speed), name="drive"),
                Revolute(body.at("crank"), shaft.at("pin"), name="pin"),
                Revolute(body.at("slider"), slider.at(), name="wrist"),
                Prismatic(slider.at(), ground.at(), name="guide"),
            ],
        )
    )


def _rod(
    length: float, side: float, density: float, modulus: Number
) -> tuple[Inertia, Array, np.ndarray, np.ndarray]:
    """Inertia, stiffness, points and shapes of the rod, by the integrals of the paper."""
    volume = side**2 * length
    mass = density * volume
    modal = mass * np.diag([0.5, 0.5, 8.0, 2.0])
    modal[2, 3] = modal[3, 2] = mass
    gyration = np.zeros((4, 4))
    gyration[2:, 0] = -16 / PI**3, 8 / PI**3 - 1 / PI
    gyration[3, 1] = 0.5 / PI
    lateral, along = np.array([2 / PI, 0, 0, 0]), np.array([0, 0, 2 / 3, 1 / 6])
    inertia = Inertia(
        mass,
        mass * (length**2 / 3 + side**2 / 12),
        modal=modal,
        first_moment=(mass * length / 2, 0.0),
        shift=mass * np.stack([along, lateral]),
        swing=mass * length * np.array([1 / PI, -0.5 / PI, 0, 0]),
        stretch=mass * length * np.array([0, 0, 1 / 3, 1 / 6]),
        gyration=mass * (gyration - gyration.T),
    )
    stiffness = np.diag([PI**4 / 24, PI**4 * 2 / 3, 0, 0]) * (side / length) ** 2
    stiffness[2:, 2:] = np.array([(16, -8), (-8, 7)]) / 3
    # Both ports, then points along the rod for pictures.
    place = np.append([0.0, 1.0], np.linspace(0.0, 1.0, 21))
    shapes = np.zeros((len(place), 3, 4))
    for k in (1, 2):
        # The mathematics of Python has the same digits on every machine.
        shapes[:, 1, k - 1] = [math.sin(k * math.pi * x) for x in place]
        shapes[:, 2, k - 1] = [k * math.pi / length * math.cos(k * math.pi * x) for x in place]
    shapes[:, 0, 2:] = np.stack([4 * place * (1 - place), place * (2 * place - 1)], axis=1)
    points = np.stack([length * place, np.zeros_like(place)], axis=1)
    return inertia, as_array(modulus) * side**2 / length * jnp.asarray(stiffness), points, shapes
