"""A rotating blade that the rotation stiffens."""

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Ramp


def rotating_blade(
    *,
    length: float = 8.0,  # [m]
    mass: Number = 10.0,  # [kg]
    EI: Number = 2.048e4,  # [N m²]
    speed: Number = 10.0,  # of the rotation [rad/s]
    kick: Number = 0.5,  # of the first mode at the start [kg^½ m]
    modes: int = 3,
) -> Scene:
    """A uniform blade, clamped to an axis that turns steadily, bent at the start and released.

    Bending pulls the blade inwards by ½ ∫w'² ds (`stiffening`), against which the rotation pulls it
    out. With λ = ω √(m l³/EI) and η of the speed, the frequency across the plane of rotation is
    tabulated by Wright, Smith, Thresher and Wang ("Vibration modes of centrifugally stiffened
    beams", J. Appl. Mech. 49, 1982), such as 6.4495 at η = 5; in the plane it is √(λ² − η²). A
    linear blade would not stay at all above η = 3.516.
    """
    blade = Beam(
        "blade",
        mass,
        length,
        EI=EI,
        modes=modes,
        shapes="clamped-free",
        stiffening=True,
        position=(length / 2, 0.0),
        velocity=(0.0, speed * length / 2),
        angular_velocity=speed,
        amplitudes=[kick, *[0.0] * (modes - 1)],
    )
    root = blade.at("start")
    return Scene(
        bodies=[blade],
        joints=[
            Revolute(root, ground.at(), name="bearing"),
            PrescribedAngle(root, ground.at(), Ramp(speed), name="drive"),
        ],
    )
