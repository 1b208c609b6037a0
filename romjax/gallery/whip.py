"""A whip that cracks."""

from ..common.arrays import Number
from ..scene.body.rod import Rod
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step


def whip(
    *,
    length: float = 1.0,  # [m]
    mass: Number = 0.1,  # [kg]
    EI: Number = 0.2,  # [N m²]
    angle: Number = 3.0,  # of the stroke [rad]
    duration: Number = 0.6,  # [s]
    modes: int = 5,
) -> Scene:
    """The thick end of a flexible lash is turned and stopped: the other end lags, then overtakes,
    faster than that of a rigid bar ever was.
    """
    lash = Rod("lash", mass, length, EI, modes, shapes="clamped-free", rotary=1e-6)
    lash = lash.placed("start", ground.pose((0.0, 0.0)))
    grip, hand = lash.at("start"), ground.at((0.0, 0.0))
    stroke = PrescribedAngle(grip, hand, Step(angle, 0.0, duration), name="stroke")
    return Scene([lash], [Revolute(grip, hand, name="hand"), stroke])
