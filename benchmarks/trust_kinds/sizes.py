"""Mechanisms of other kinds, from a millimetre to a kilometre, with a motion that is alike.

Where all lengths are λ times as long, the same motion under gravity takes √λ times as long, so that
the truth is λ times that of the mechanism of a metre.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import romjax as rj

from . import driven, planar, spatial
from .kind import Kind, Numbers, moved
from .planar import log

# The powers of length of numbers; those of "x" and "v" in the plane are of places, then angles.
POWERS = {
    "lengths": 1.0,
    "inertias": 2.0,
    "moments": 2.0,
    "feet": 1.0,
    "rod": 1.0,
    "arms": 1.0,
    "tips": 1.0,
    "spins": -0.5,
    "turning": -0.5,
    "frequency": -0.5,
    "end": 0.5,
}


def sized(p: Numbers) -> Numbers:
    """The numbers of the mechanism of another size."""
    size, space = p["size"], "turns" in p
    found = {name: x * size ** POWERS.get(name, 0.0) for name, x in p.items()}
    for name, power in (("x", 1.0), ("v", 0.5)):
        # Angles have none, and their rates that of one over time.
        powers = power - (0.0 if space else np.array([0.0, 0.0, 1.0]))
        found[name] = p[name] * size**powers
    return found


def of_any_size(kind: Kind, scene: Callable[[Numbers], rj.Scene]) -> Kind:
    def draw(chance: np.random.Generator) -> Numbers:
        return {**kind.draw(chance), "size": np.asarray(log(chance, 1e-3, 1e3))}

    def truth(p: Numbers, nudge: float = 0.0) -> np.ndarray:
        own = {name: x for name, x in p.items() if name != "size"}
        return np.asarray(p["size"] * kind.truth(own, nudge))

    def made(p: Numbers) -> rj.Scene:
        return scene(sized(p))

    def move(p: Numbers, **settings: Any) -> Any:
        return moved(made)({**p, "end": sized(p)["end"]}, **settings)

    return Kind(draw, move, truth)


SCENES: dict[str, tuple[dict[str, Kind], Callable[[Numbers], rj.Scene]]] = {
    "parallelogram": (planar.KINDS, planar.parallelogram_scene),
    "four-bar, pinned twice": (planar.KINDS, lambda p: planar.four_bar_scene(p, True)),
    "driven parallelogram": (
        driven.KINDS,
        lambda p: driven.driven(planar.parallelogram_scene(p), p),
    ),
    "chain in space": (spatial.KINDS, spatial.chain_scene),
    "levers in space": (spatial.KINDS, spatial.levers_scene),
}
KINDS = {
    f"{name}, any size": of_any_size(kinds[name], scene) for name, (kinds, scene) in SCENES.items()
}
