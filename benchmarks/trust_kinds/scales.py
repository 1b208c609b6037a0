"""Motions of all sizes, in mechanisms of millimetres to kilometres, stiff and soft.

The truth of masses on springs is the closed form by their modes; of a small swing the motion of one
angle by SciPy's DOP853; of equilibria and modes closed forms.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy.linalg

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import GRAVITY, integrated
from .planar import CHAINS, chain_scene, log, solid

COUNT = 3


# Masses on springs in a row, from a wall to a wall.


def stiffness_of(k: np.ndarray) -> np.ndarray:
    """The matrix of a row of springs."""
    return np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)


def draw_row(chance: np.random.Generator) -> Numbers:
    """Of one size, mass and frequency each, and of a motion down to a nanometre."""
    size, mass = log(chance, 1e-3, 1e3), log(chance, 1e-3, 1e3)
    masses = mass * log(chance, 0.1, 10.0, COUNT)
    k = mass * log(chance, 0.1, 1e3) ** 2 * log(chance, 0.03, 30.0, COUNT + 1)
    slowest = np.sqrt(scipy.linalg.eigvalsh(stiffness_of(k), np.diag(masses))[0])
    # Masses stay in their order.
    moves = min(1.0, 0.1 * size) * log(chance, 1e-6, 1.0)
    u, rate = moves * chance.uniform(-1.0, 1.0, (2, COUNT))
    return {
        "masses": masses,
        "k": k,
        "rest": size * np.ones(COUNT + 1),
        "u": u,
        "rate": slowest * rate,
        "at": size * np.arange(1.0, COUNT + 1),
        "end": np.asarray(log(chance, 0.3, 20.0) / slowest),
    }


def row_scene(p: Numbers) -> rj.Scene:
    xp = np if isinstance(p["u"], np.ndarray) else jnp
    bodies, joints, springs = [], [], []
    last = rj.ground.at()
    for i in range(COUNT):
        place = xp.stack([p["at"][i] + p["u"][i], 0.0 * p["u"][i]])
        rate = xp.stack([p["rate"][i], 0.0 * p["u"][i]])
        own = {"position": place, "velocity": rate}
        body = rj.RigidBody(f"mass{i}", p["masses"][i], p["masses"][i] * p["rest"][0] ** 2, **own)
        bodies.append(body)
        joints.append(rj.Prismatic(body.at(), rj.ground.at()))
        springs.append(rj.Spring(last, body.at(), p["k"][i], p["rest"][i]))
        last = body.at()
    wall = xp.stack([p["at"][-1] + p["rest"][-1], 0.0 * p["at"][-1]])
    springs.append(rj.Spring(last, rj.ground.at(wall), p["k"][-1], p["rest"][-1]))
    return rj.Scene(bodies, joints, springs)


def row_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    """Displacements; those that romjax gives are less the places of rest."""
    squares, modes = scipy.linalg.eigh(stiffness_of(p["k"]), np.diag(p["masses"]))
    omega = np.sqrt(squares)
    u = p["u"] + nudge * np.max(np.abs(p["u"]))
    a, b = (modes.T @ (p["masses"] * x) for x in (u, p["rate"]))
    phase = np.outer(times(p["end"]), omega)
    return (np.cos(phase) * a + np.sin(phase) * b / omega) @ modes.T


def move_row(p: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
    places, run = moved(row_scene)(p, **settings)
    return places[:, ::2] - p["at"][None], run


# A swing of a nanometre to a metre about the lowest place of a bar of any length.


def draw_swing(chance: np.random.Generator) -> Numbers:
    length = log(chance, 1e-3, 1e3)
    swing = min(0.5, log(chance, 1e-9, 1.0) / length)
    start = {"s": np.array([swing - np.pi / 2]), "ds": np.zeros(1), "swing": np.asarray(swing)}
    numbers = solid(log(chance, 1e-3, 1e3, 1), np.array([length]))
    turns = log(chance, 0.5, 5.0)
    return CHAINS[1].start({**numbers, **start, "end": turns * 2 * np.pi * np.sqrt(length / 15)})


def move_swing(p: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
    """How far the bar is from its lowest place."""
    places, run = moved(chain_scene)(p, **settings)
    return places + p["lengths"][0] / 2 * np.array([0.0, 1.0]), run


def swing_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    """By the angle from the lowest place, which keeps the digits of small ones."""
    length = p["lengths"][0]
    angle = integrated(
        lambda t, y: np.array([y[1], -1.5 * GRAVITY / length * np.sin(y[0])]),
        times(p["end"]),
        np.array([p["swing"] * (1 + nudge), 0.0]),
    )[:, 0]
    return length * np.stack([np.sin(angle) / 2, np.sin(angle / 2) ** 2], axis=1)


# Equilibria and modes.


def hanging_scene(p: Numbers) -> rj.Scene:
    """The row upright under gravity."""
    scene = row_scene({**p, "rate": 0.0 * p["u"]})
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, rj.Gravity((GRAVITY, 0.0))])


def move_hanging(p: Numbers) -> tuple[Any, None]:
    """How far the masses sag."""
    system = rj.assemble(hanging_scene(p))
    return (rj.equilibrium(system)[np.ravel(system.structure.positions)][::2] - p["at"])[None], None


def sag(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    del nudge
    return np.linalg.solve(stiffness_of(p["k"]), GRAVITY * p["masses"])[None]


def draw_hanging(chance: np.random.Generator) -> Numbers:
    """So stiff that masses stay in their order."""
    p = draw_row(chance)
    reach = np.max(np.abs(sag(p)))
    return {**p, "k": p["k"] * reach / (p["rest"][0] * log(chance, 1e-4, 0.3))}


def move_modes(p: Numbers) -> tuple[Any, None]:
    return rj.modes(rj.assemble(row_scene({**p, "u": 0.0 * p["u"]}))).frequencies[None], None


def row_modes(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    """Natural frequencies [rad/s]."""
    del nudge
    return np.sqrt(scipy.linalg.eigvalsh(stiffness_of(p["k"]), np.diag(p["masses"])))[None]


KINDS = {
    "masses on springs": Kind(draw_row, move_row, row_motion),
    "small swing": Kind(draw_swing, move_swing, swing_motion),
    "sag": Kind(draw_hanging, move_hanging, sag, ways=("alone",)),
    "natural frequencies": Kind(draw_row, move_modes, row_modes, ways=("alone",)),
}
