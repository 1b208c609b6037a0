"""Mechanisms in the coordinates of their joints, with the truths of other kinds."""

from collections.abc import Callable
from typing import Any

import romjax as rj

from . import driven, flexible, loads, planar, spatial
from .kind import Kind, Numbers, places, times

Move = Callable[..., tuple[Any, rj.Trajectory]]


def in_joints(scene: Callable[[Numbers], rj.Scene]) -> Move:
    """As `moved`, in joint coordinates."""

    def move(numbers: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
        system = rj.reduce(rj.assemble(scene(numbers)), formulation=rj.JointCoordinates())
        run = rj.simulate(system, times(numbers["end"]), **settings)
        return places(system.full, run), run

    return move


SCENES = {
    "chain of three": (planar.KINDS, planar.chain_scene),
    "four-bar, pinned twice": (planar.KINDS, lambda p: planar.four_bar_scene(p, True)),
    "driven cart": (driven.KINDS, driven.cart_scene),
    "flexible rod": (flexible.KINDS, flexible.slider_crank_scene),
    "pulse": (loads.KINDS, loads.scene_of(loads.table)),
    "chain in space": (spatial.KINDS, spatial.chain_scene),
    "levers in space": (spatial.KINDS, spatial.levers_scene),
    "four-bar in space": (spatial.KINDS, spatial.flat_scene),
}
KINDS = {
    f"{name}, by its joints": Kind(kinds[name].draw, in_joints(scene), kinds[name].truth)
    for name, (kinds, scene) in SCENES.items()
}
