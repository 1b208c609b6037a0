"""A chain of equal bars."""

import itertools

from ..common.errors import SceneError
from ..scene.body.rigid import RigidBody
from ..scene.effect.gravity import Gravity
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene


def chain(links: int = 8) -> Scene:
    """`links` uniform bars of 1 m and 1 kg, hinged end to end from the origin.

    At rest along +x, gravity 9.81 m/s² along −y. The scene that shows how cost grows with size.
    """
    if links < 1:
        raise SceneError(f"chain: links is {links}, but a chain needs at least one.")
    bars = [
        RigidBody(f"bar{i + 1}", mass=1.0, inertia=1 / 12, position=(i + 0.5, 0.0), extent=(1, 0.1))
        for i in range(links)
    ]
    hinges = [Revolute(bars[0].at((-0.5, 0.0)), ground.at())]
    hinges += [Revolute(b.at((-0.5, 0.0)), a.at((0.5, 0.0))) for a, b in itertools.pairwise(bars)]
    return Scene(bodies=bars, joints=hinges, effects=[Gravity()])
