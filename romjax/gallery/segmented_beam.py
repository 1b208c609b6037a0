"""A beam of hinged segments, rolled up."""

import itertools
import math

from ..common.arrays import Number
from ..scene.body.beam import Beam
from ..scene.effect.damper import Damper
from ..scene.effect.torque import Torque
from ..scene.effect.torsion_spring import TorsionSpring
from ..scene.joint.revolute import Revolute
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Step


def segmented_beam(
    segments: int = 32,
    *,
    length: float = 1.0,  # [m]
    mass: Number = 1.0,  # [kg]
    EI: Number = 1.0,  # [N m²]
    damping: Number = 5.0,  # of the liquid that it lies in, per length [N s/m²]
    duration: Number = 1.5,  # of the rise of the moment [s]
) -> Scene:
    """A cantilever of rigid segments with springs between them, rolled up by a moment at its tip.

    Each of the n − 1 hinges has a spring n EI/l and turns by M l / (n EI). The moment

        M = 2π EI/l · n / (n − 1)

    turns the tip once: beyond the clamped segment the hinges lie on a circle, as an elastic line
    would, to any size of deflection, where the bending of one floating beam is small.
    """
    size = length / segments
    bars = [
        Beam(f"segment{i + 1}", mass / segments, size, position=((i + 0.5) * size, 0.0))
        for i in range(segments)
    ]
    pairs = [(b.at("start"), a.at("end")) for a, b in itertools.pairwise(bars)]
    moment = 2 * math.pi * EI / length * segments / (segments - 1)
    return Scene(
        bodies=bars,
        joints=[
            Weld(bars[0].at("start"), ground.at(), name="clamp"),
            *(Revolute(b, a) for b, a in pairs),
        ],
        effects=[
            *(TorsionSpring(b, a, stiffness=segments * EI / length) for b, a in pairs),
            *(Damper(bar.at(), ground.at(), damping=damping * size) for bar in bars),
            Torque(bars[-1].at("end"), Step(moment, 0.0, duration)),
        ],
    )
