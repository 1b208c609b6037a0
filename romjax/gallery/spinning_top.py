"""A heavy top."""

import numpy as np

from ..common.arrays import Number
from ..scene.body.spatial.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.joint.spatial.spherical import Spherical
from ..scene.marker import ground
from ..scene.scene import Scene
from .digits import decimal, drawn


def spinning_top(
    *,
    mass: Number = 15.0,  # [kg]
    arm: float = 1.0,  # from the tip to the centre of mass [m]
    moments: tuple[Number, Number] = (0.234375, 0.46875),  # across and along the axis [kg m²]
    spin: Number = 150.0,  # about the axis [rad/s]
    precession: Number = -4.61538,  # about the vertical, at the start [rad/s]
) -> Scene:
    """A top on a ball joint whose axis is level at the start, and nods as it precesses.

    The top of Brüls, Cardona and Arnold ("Lie group generalized-α time integration of constrained
    flexible multibody systems", Mech. Mach. Theory 48, 2012, section 5, doi:10.1016/
    j.mechmachtheory.2011.07.017), whose angular momentum along the axis and about the vertical
    stay, since nothing acts about them.
    """
    across, along = moments
    body = RigidBody(
        "top",
        mass,
        np.array([1.0, 0.0, 1.0]) * across + np.array([0.0, 1.0, 0.0]) * along,
        position=(0.0, arm, 0.0),
        velocity=np.array([-1.0, 0.0, 0.0]) * arm * precession,
        angular_velocity=np.array([0.0, 1.0, 0.0]) * spin + np.array([0.0, 0.0, 1.0]) * precession,
        extent=_cone(arm, 0.35 * arm),
        points={"tip": (0.0, -arm, 0.0)},
    )
    pivot = Spherical(body.at("tip"), ground.at((0.0, 0.0, 0.0)), name="pivot")
    return decimal(Scene(bodies=[body], joints=[pivot], effects=[Gravity((0.0, 0.0, -9.81))]))


def _cone(arm: float, radius: float) -> np.ndarray:
    """Return a line from the tip to the rim, around it, and back to the tip at every quarter."""
    angle = np.linspace(0.0, 2 * np.pi, 25)
    rim = np.stack([radius * np.cos(angle), 0.3 * arm + 0 * angle, radius * np.sin(angle)], axis=1)
    tip = np.array([[0.0, -arm, 0.0]])
    quarters = [np.concatenate([tip, rim[k : k + 7], tip]) for k in range(0, 24, 6)]
    outline: np.ndarray = drawn(np.concatenate(quarters)[:-1])
    return outline
