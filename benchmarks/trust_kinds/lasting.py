"""Motions of tens to hundreds of swings, rounds, vibrations and bounces, in which errors add up.

The truth of a vibration is a closed form, that of all others their motion by SciPy's DOP853.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from . import contacts, stops
from .kind import Kind, Numbers, moved, times
from .minimal import GRAVITY, integrated
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


# A mass between stretched springs, which is hit where they balance, or let go, and hardly damped.


def draw_hit(chance: np.random.Generator) -> Numbers:
    length, mass, omega = log(chance, 1e-3, 1e3), log(chance, 1e-3, 1e3), log(chance, 0.1, 1e3)
    way = chance.normal(size=2)
    way *= length * log(chance, 1e-2, 0.5) / np.linalg.norm(way)
    is_hit = chance.choice([0.0, 1.0])
    ratio = chance.choice([0.0, log(chance, 1e-5, 1e-2)])
    return {
        "mass": np.asarray(mass),
        "length": np.asarray(length),
        "k": np.asarray(mass * omega**2 / 2),
        "rest": np.asarray(length * chance.uniform(0.1, 0.8)),
        "c": np.asarray(ratio * mass * omega),
        "x": (1 - is_hit) * way,
        "v": is_hit * omega * way,
        "end": np.asarray(log(chance, FEWEST, MOST) * 2 * np.pi / omega),
    }


ENDS = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])


def hit_scene(p: Numbers) -> rj.Scene:
    share = 0.1 * p["mass"] * p["length"] ** 2
    body = rj.RigidBody("body", p["mass"], share, position=p["x"], velocity=p["v"])
    effects: list[Any] = []
    for end in ENDS:
        at = rj.ground.at(p["length"] * end)
        effects += [
            rj.Spring(body.at(), at, p["k"], p["rest"]),
            rj.Damper(body.at(), at, p["c"], along_line=True),
        ]
    return rj.Scene([body], effects=effects)


def hit_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    ends = p["length"] * ENDS

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        del t
        apart = y[:2] - ends
        size = np.linalg.norm(apart, axis=1, keepdims=True)
        out = apart / size
        pull = p["k"] * (size - p["rest"]) + p["c"] * out @ y[2:, None]
        return np.concatenate([y[2:], -np.sum(pull * out, axis=0) / p["mass"]])

    moved = np.concatenate([p["x"] + nudge * 0.1 * p["length"], (1 + nudge) * p["v"]])
    return integrated(rate, times(p["end"]), moved)[:, :2]


# Bodies that bounce.


def loss(chance: np.random.Generator) -> np.ndarray:
    """Often none, or little."""
    return np.asarray(chance.choice([0.0, 0.0, log(chance, 1e-5, 1e-1)]))


def draw_bounces(chance: np.random.Generator) -> Numbers:
    """On a level plane, up to a hundred times."""
    height, count = log(chance, 1e-2, 1.0), log(chance, 3.0, 100.0)
    end, speed = count * np.sqrt(8 * height / GRAVITY), np.array([chance.uniform(-1.0, 1.0), 0.0])
    p = contacts.drawn(chance, height, speed, end, steep=0.0)
    return {**p, "loss": loss(chance)}


def draw_strikes(chance: np.random.Generator) -> Numbers:
    """Of a hinge against its stops, up to thirty times as often."""
    p = stops.draw_hinge(chance)
    return {**p, "loss": loss(chance), "end": p["end"] * log(chance, 3.0, 30.0)}


def draw_ups_and_downs(chance: np.random.Generator) -> Numbers:
    """Of a slide between its stops; none is a graze, each of which would magnify errors."""
    p = stops.draw_slide(chance)
    rise = p["speed"] ** 2 / (2 * GRAVITY * p["axis"][2])
    own = {"stops": np.array([p["stops"][0], rise * chance.uniform(0.3, 0.8)])}
    return {**p, **own, "loss": loss(chance), "end": p["end"] * log(chance, 3.0, 30.0)}


KINDS = {
    "many swings": Kind(draw_swings, moved(chain_scene), CHAINS[1].motion),
    "many rounds": Kind(lambda chance: draw_rounds(chance, 2), moved(rounds_scene), rounds_motion),
    "many rounds in space": Kind(
        lambda chance: draw_rounds(chance, 3), moved(rounds_scene), rounds_motion
    ),
    "many vibrations": Kind(draw_vibration, move_vibration, vibration),
    "many vibrations between springs": Kind(draw_hit, moved(hit_scene), hit_motion),
    "many bounces": Kind(draw_bounces, moved(contacts.bounces_scene), contacts.motion),
    "many strikes of a hinge": Kind(draw_strikes, moved(stops.hinge_scene), stops.hinge_motion),
    "many strikes of a slide": Kind(
        draw_ups_and_downs, moved(stops.slide_scene), stops.slide_motion
    ),
}
