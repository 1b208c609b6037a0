"""A ring of spring steel that uncoils."""

import math

from ..common.arrays import Number
from ..scene.body.rod import Rod
from ..scene.joint.weld import Weld
from ..scene.marker import ground
from ..scene.scene import Scene
from .arcs import arc


def uncoiling_strip(
    *,
    length: float = 0.6,  # [m]
    mass: Number = 0.03,  # [kg]
    EI: Number = 0.02,  # [N m²]
    modes: int = 6,
) -> Scene:
    """A strip, clamped at one end and rolled up to a ring, is released: it uncoils, and whips
    beyond the straight.

    Its elastic energy at the start is that of a circle, 2 π² EI / L, which no linear beam has.
    """
    rolled = arc(Rod("strip", mass, length, EI, modes), 2 * math.pi)
    # The frame is in the middle, above the clamp, and upside down.
    strip = Rod(
        "strip",
        mass,
        length,
        EI,
        modes,
        position=(0.0, length / math.pi),
        angle=math.pi,
        amplitudes=rolled,
    )
    return Scene([strip], [Weld(strip.at("start"), ground.at((0.0, 0.0)), name="clamp")])
