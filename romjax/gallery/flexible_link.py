"""A robot's link in space that sags and lags."""

import numpy as np

from ..common.arrays import Number
from ..scene.body.spatial.rod import Rod
from ..scene.effect.gravity import Gravity
from ..scene.effect.torque import Torque
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.orientation import euler
from ..scene.scene import Scene
from ..scene.signal import Step, Sum


def flexible_link(
    *,
    length: float = 1.0,  # [m]
    mass: Number = 0.3,  # [kg]
    EI: tuple[float, float] = (1.0, 0.5),  # aside, and up and down [N m²]
    torque: float = 1.0,  # about the vertical [N m]
    duration: Number = 0.3,  # of it, and once more to begin and to end [s]
    modes: int = 4,
) -> Scene:
    """A link that bends far, level at the start, falls under its weight while a drive swings it
    about the vertical: it bends in two planes and twists.

    The torque T of the drive for a time τ, which grows and falls as smoothly as long, leaves the
    angular momentum 2 T τ about the vertical, however the link bends.
    """
    # Local y is up, and local z is level.
    link = Rod(
        "link",
        mass,
        length,
        EI,
        0.5 * EI[1],
        (2e-4, 1e-4, 1e-4),
        modes,
        shapes="clamped-free",
        orientation=euler("XYZ", (0.5 * np.pi, 0.0, 0.0)),
    ).placed("start", ground.pose((0.0, 0.0, 0.0)))
    up = np.array([0.0, 1.0, 0.0])
    foot, base = link.at("start", axis=up), ground.at((0.0, 0.0, 0.0))
    drive = Sum((Step(torque, 0.0, duration), Step(-torque, 2 * duration, duration)))
    return Scene(
        [link],
        [Revolute(foot, base, name="yaw")],
        [Gravity((0.0, 0.0, -9.81)), Torque(foot, drive, (0.0, 0.0, 1.0))],
    )
