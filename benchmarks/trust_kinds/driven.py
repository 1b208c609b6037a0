"""Planar mechanisms whose motion is given in part or in full.

Without a freedom left the truth is geometry, the smooth continuation where positions are singular;
with one it is the motion in minimal coordinates by SciPy's DOP853 (`minimal.py`).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import Minimal
from .planar import (
    along,
    bars,
    ends,
    four_bar_joints,
    four_bar_places,
    grashof,
    log,
    parallelogram_places,
    parallelogram_scene,
    solid,
)


def drive(chance: np.random.Generator, end: float) -> Numbers:
    """Some turns of a crank, or some swings, or both."""
    turns, swings = [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)][chance.integers(3)]
    return {
        "turning": np.asarray(turns * log(chance, 0.3, 40.0) / end),
        "swing": np.asarray(swings * chance.uniform(0.1, 2.0)),
        "frequency": np.asarray(log(chance, 0.3, 10.0) / end),
        "from": np.asarray(chance.uniform(-3.0, 3.0)),
    }


def driven_angle(p: Numbers, t: Any) -> Any:
    swing = p["swing"] * jnp.sin(2 * jnp.pi * p["frequency"] * t)
    return p["from"] + p["turning"] * t + swing


def signal(p: Numbers) -> rj.AbstractSignal:
    turn = rj.Ramp(p["turning"], p["from"])
    return rj.Sum((turn, rj.Sine(p["swing"], p["frequency"])))


class Given:
    """A mechanism without freedom: its places (p, t, s) at the `angle` (p, t) that drives it."""

    def __init__(self, positions: Any, angle: Any = driven_angle):
        def at(p: Numbers, t: Any) -> Any:
            return positions(p, t, angle(p, t)[None])

        self._start = jax.jit(lambda p: jax.jvp(lambda t: at(p, t), (0.0,), (1.0,)))
        self._seen = jax.jit(lambda p, ts: jax.vmap(lambda t: at(p, t)[:, :2])(ts))

    def start(self, p: Numbers) -> Numbers:
        x, v = self._start(p)
        return {**p, "x": np.asarray(x), "v": np.asarray(v)}

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        moved_on = {**p, "from": p["from"] + nudge}
        ts = times(p["end"])
        return np.asarray(self._seen(moved_on, ts)).reshape(len(ts), -1)


FOUR_BAR, PARALLELOGRAM = Given(four_bar_places), Given(parallelogram_places)


def draw_four_bar(chance: np.random.Generator) -> Numbers:
    lengths, end = grashof(chance), log(chance, 0.2, 10.0)
    numbers = solid(log(chance, 0.1, 10.0, 3), lengths[:3]) | {"lengths": lengths, "end": end}
    return FOUR_BAR.start({**numbers, **drive(chance, end)})


def driven(scene: rj.Scene, p: Numbers) -> rj.Scene:
    """The same with its first bar turned."""
    motor = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), signal(p))
    return rj.Scene(scene.bodies, [*scene.joints, motor], scene.effects)


def four_bar_scene(p: Numbers) -> rj.Scene:
    links = bars(p)
    return driven(rj.Scene(links, four_bar_joints(p, links), [rj.Gravity()]), p)


def draw_parallelogram(chance: np.random.Generator) -> Numbers:
    crank, base = chance.uniform(0.3, 1.5), chance.uniform(0.5, 2.5)
    lengths, end = np.array([crank, base, crank]), log(chance, 0.2, 10.0)
    numbers = solid(log(chance, 0.1, 10.0, 3), lengths)
    numbers |= {"share": np.asarray(0.5), "end": end}
    return PARALLELOGRAM.start({**numbers, **drive(chance, end)})


# A cart whose way is given, with a pendulum.


def cart_places(p: Numbers, t: Any, s: Any) -> Any:
    """Cart and pendulum."""
    cart = jnp.stack([driven_angle(p, t), jnp.zeros(()), jnp.zeros(())])
    hung = cart[:2] + along(p["lengths"][1], s[0]) / 2
    return jnp.stack([cart, jnp.append(hung, s[0])])


CART = Minimal(cart_places)


def draw_cart(chance: np.random.Generator) -> Numbers:
    end = log(chance, 0.3, 4.0)
    numbers = solid(log(chance, 0.1, 10.0, 2), log(chance, 0.2, 2.0, 2))
    start = {"s": chance.uniform(-3.0, 0.0, 1), "ds": chance.uniform(-3.0, 3.0, 1), "end": end}
    return CART.start({**numbers, **start, **drive(chance, end)})


def cart_scene(p: Numbers) -> rj.Scene:
    cart, bar = bars(p)
    joints = [
        rj.Prismatic(cart.at(), rj.ground.at()),
        rj.PrescribedTravel(cart.at(), rj.ground.at(), signal(p)),
        rj.Revolute(ends(bar, p["lengths"][1])[0], cart.at()),
    ]
    return rj.Scene([cart, bar], joints, [rj.Gravity()])


KINDS = {
    "driven four-bar": Kind(draw_four_bar, moved(four_bar_scene), FOUR_BAR.motion),
    "driven parallelogram": Kind(
        draw_parallelogram,
        moved(lambda p: driven(parallelogram_scene(p), p)),
        PARALLELOGRAM.motion,
    ),
    "driven cart": Kind(draw_cart, moved(cart_scene), CART.motion),
}
