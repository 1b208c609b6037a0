"""Motions of tens to hundreds of swings, rounds and vibrations, in which errors add up.

The truth of swings and rounds is their motion by SciPy's DOP853, that of a vibration a closed form.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import integrated
from .planar import CHAINS, chain_scene, log, solid

FEWEST, MOST = 10.0, 300.0


def draw_swings(chance: np.random.Generator) -> Numbers:
    """A bar that is let go far from its lowest place."""
    length, angle = log(chance, 0.1, 3.0), chance.uniform(0.2, 2.5)
    numbers = solid(log(chance, 0.1, 10.0, 1), np.array([length]))
    start = {"s": np.array([angle - np.pi / 2]), "ds": np.zeros(1)}
    end = log(chance, FEWEST, MOST) * 2 * np.pi * np.sqrt(length / 15)
    return CHAINS[1].start({**numbers, **start, "end": np.asarray(end)})


# A body that goes round on a spring, and does not turn.


def draw_rounds(chance: np.random.Generator, dimension: int) -> Numbers:
    """On ovals of any plane; no spring is as short as nothing."""
    mass, k, distance = log(chance, 0.1, 10.0), log(chance, 1.0, 1e3), log(chance, 0.1, 3.0)
    rest = distance * chance.uniform(0.1, 0.8)
    speed = distance * np.sqrt(k / mass * (1 - rest / distance))
    out, way = np.linalg.qr(chance.normal(size=(dimension, 2)))[0].T
    return {
        "mass": np.asarray(mass),
        "k": np.asarray(k),
        "rest": np.asarray(rest),
        "x": distance * out,
        "v": speed * chance.uniform(0.3, 1.5) * way,
        "end": np.asarray(log(chance, FEWEST, MOST) * 2 * np.pi * distance / speed),
    }


def rounds_scene(p: Numbers) -> rj.Scene:
    own = {"position": p["x"], "velocity": p["v"]}
    share = 0.1 * p["mass"] * p["rest"] ** 2
    if len(p["x"]) == 2:
        body = rj.RigidBody("body", p["mass"], share, **own)
    else:
        xp = np if isinstance(share, np.ndarray) else jnp
        body = rj.spatial.RigidBody("body", p["mass"], share * xp.ones(3), **own)
    centre = rj.ground.at((0.0,) * len(p["x"]))
    return rj.Scene([body], [], [rj.Spring(body.at(), centre, p["k"], p["rest"])])


def rounds_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    d = len(p["x"])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        pull = p["k"] / p["mass"] * (1 - p["rest"] / np.linalg.norm(y[:d]))
        return np.concatenate([y[d:], -pull * y[:d]])

    return integrated(rate, times(p["end"]), np.concatenate([p["x"] * (1 + nudge), p["v"]]))[:, :d]


# A mass on a spring, which nothing damps.


def draw_vibration(chance: np.random.Generator) -> Numbers:
    size, mass = log(chance, 1e-3, 1e3), log(chance, 1e-3, 1e3)
    omega = log(chance, 0.1, 1e3)
    return {
        "mass": np.asarray(mass),
        "k": np.asarray(mass * omega**2),
        "rest": np.asarray(size),
        "u": np.asarray(min(1.0, 0.3 * size) * log(chance, 1e-2, 1.0)),
        "end": np.asarray(log(chance, FEWEST, MOST) * 2 * np.pi / omega),
    }


def vibration_scene(p: Numbers) -> rj.Scene:
    xp = np if isinstance(p["u"], np.ndarray) else jnp
    at = xp.stack([p["rest"] + p["u"], 0.0 * p["u"]])
    body = rj.RigidBody("body", p["mass"], p["mass"] * p["rest"] ** 2, position=at)
    spring = rj.Spring(body.at(), rj.ground.at(), p["k"], p["rest"])
    return rj.Scene([body], [rj.Prismatic(body.at(), rj.ground.at())], [spring])


def move_vibration(p: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
    """Displacements from the place where the spring is at rest."""
    places, run = moved(vibration_scene)(p, **settings)
    return places[:, :1] - p["rest"], run


def vibration(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    phase = np.sqrt(p["k"] / p["mass"]) * times(p["end"])
    return (1 + nudge) * p["u"] * np.cos(phase)[:, None]


KINDS = {
    "many swings": Kind(draw_swings, moved(chain_scene), CHAINS[1].motion),
    "many rounds": Kind(lambda chance: draw_rounds(chance, 2), moved(rounds_scene), rounds_motion),
    "many rounds in space": Kind(
        lambda chance: draw_rounds(chance, 3), moved(rounds_scene), rounds_motion
    ),
    "many vibrations": Kind(draw_vibration, move_vibration, vibration),
}
