"""Mechanisms with a rod that bends far: each with a motion to train with, and others to predict."""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from native_models import Element

import romjax as rj
from romjax import spatial as r

ORIGIN = rj.ground.pose((0.0, 0.0))
MANY = 12  # shapes of the rod that errors are measured by


class Case(NamedTuple):
    """`scene(modes, **numbers)`, simulated for `end` [s]; without numbers it is the training.

    `others`: numbers of the motions that no snapshot is from. `body`, `point`: where errors are
    measured. `many`: the shapes of what they are measured by. `ranks`: those of reduced
    models, with the largest errors that are asked for.
    """

    scene: Callable[..., rj.Scene]
    end: float
    body: str
    point: str
    others: tuple[dict[str, float], ...]
    many: int = MANY
    ranks: tuple[tuple[int, float], ...] = ((4, 1e-3), (6, 2.5e-4))


def pendulum(
    modes: int,
    EI: float = 0.1,
    angle: float = 0.0,
    gravity: float = 9.81,
    force: float = 0.0,
    rotary: float = 1e-3,
) -> rj.Scene:
    """A rod of 1 m and 1 kg on a hinge, level unless turned; released, its tip turns by more than
    a radian against the hinge. `force` [N] acts along x at its free end.
    """
    rod = rj.Rod("rod", 1.0, 1.0, EI, modes, shapes="pinned-free", rotary=rotary, angle=angle)
    rod = rod.placed("start", ORIGIN)
    hinge = rj.Revolute(rod.at("start"), rj.ground.at((0.0, 0.0)), name="hinge")
    load = rj.Force(rod.at("end"), (1.0, 0.0), rj.Constant(force))
    return rj.Scene([rod], [hinge], [rj.Gravity((0.0, -gravity)), load])


CRANK, COUPLER, ROCKER, GROUND = 0.4, 1.2, 0.8, 1.2  # [m]
# EA = GA [N] of the coupler's elements; the rotary inertia [kg m] is that of a section, ρA EI / EA.
STIFF, ROTARY = 2e4, 1.5e-5


class Placed(NamedTuple):
    """A crank at an angle, the angles of coupler and rocker [rad], and the pins [m]."""

    coupler: float
    rocker: float
    first: np.ndarray
    second: np.ndarray


def closed(crank: float) -> Placed:
    """The loop above the ground, whose coupler is straight."""
    first = CRANK * np.array([np.cos(crank), np.sin(crank)])
    across = np.array([GROUND, 0.0]) - first
    size = np.hypot(*across)
    inner = np.arccos((COUPLER**2 + size**2 - ROCKER**2) / (2 * COUPLER * size))
    turn = np.arctan2(across[1], across[0]) + inner
    second = first + COUPLER * np.array([np.cos(turn), np.sin(turn)])
    return Placed(turn, np.arctan2(second[1], second[0] - GROUND), first, second)


def sides(crank: float) -> tuple[rj.Beam, rj.Beam]:
    """The crank and the rocker, rigid bars."""
    placed = closed(crank)
    one = rj.Beam("crank", CRANK, CRANK, angle=crank).placed("start", ORIGIN)
    other = rj.Beam("rocker", ROCKER, ROCKER, angle=placed.rocker)
    return one, other.placed("start", rj.ground.pose((GROUND, 0.0)))


def four_bar(
    modes: int,
    EI: float = 2.0,
    crank: float = np.pi / 2,
    torque: float = 2.0,
    gravity: float = 9.81,
    force: float = 0.0,
) -> rj.Scene:
    """A crank and a rocker with a rod as the coupler; `torque` [N m] drives the crank from rest,
    and `force` [N] acts along x at the middle of the coupler.
    """
    one, other = sides(crank)
    turn = closed(crank).coupler
    rod = rj.Rod(
        "coupler", 0.6, COUPLER, EI, modes, shapes="pinned-pinned", rotary=ROTARY, angle=turn
    )
    rod = rod.placed("start", one.pose("end"))
    pins = [(one.at("end"), rod.at("start")), (rod.at("end"), other.at("end"))]
    load = rj.Force(rod.at((0.0, 0.0)), (1.0, 0.0), rj.Constant(force))
    acting = [*loads(one, torque, gravity), load]
    return rj.Scene([one, rod, other], held(one, other, pins), acting)


def held(
    one: rj.Beam, other: rj.Beam, pins: list[tuple[rj.Marker, rj.Marker]]
) -> list[rj.Revolute]:
    """The four hinges."""
    grounded = [(one.at("start"), rj.ground.at()), (other.at("start"), rj.ground.at((GROUND, 0.0)))]
    return [rj.Revolute(a, b) for a, b in [*grounded, *pins]]


def loads(crank: rj.Beam, torque: float, gravity: float) -> list[Any]:
    """Gravity and the drive."""
    return [rj.Gravity((0.0, -gravity)), rj.Torque(crank.at(), rj.Constant(torque))]


def strip_in_space(
    modes: int,
    EI: float = 1.0,
    angle: float = 0.0,
    gravity: float = 9.81,
    side: float = 0.5,
    force: float = 0.0,
) -> rj.Scene:
    """A flat rod of 1 m and 1 kg on a level hinge, level along x unless turned by `angle` [rad],
    four times as stiff aside; the forces `side` along y and `force` along x [N] act at its free
    end, so that it bends in two planes and twists.
    """
    # The hinge is about local z, which is level, and local y is up.
    turned = r.euler("XYZ", (0.5 * np.pi, 0.0, angle))
    numbers = (1.0, 1.0, (4 * EI, EI), EI, (2e-3, 1e-3, 1e-3), modes)
    rod = r.Rod("rod", *numbers, shapes="hinged-free", orientation=turned)
    rod = rod.placed("start", rj.ground.pose((0.0, 0.0, 0.0)))
    loads = [
        rj.Force(rod.at("end"), way, rj.Constant(size))
        for way, size in (((1.0, 0.0, 0.0), force), ((0.0, 1.0, 0.0), side))
    ]
    hinge = r.Revolute(rod.at("start"), rj.ground.at((0.0, 0.0, 0.0), axis=(0.0, -1.0, 0.0)))
    return rj.Scene([rod], [hinge], [rj.Gravity((0.0, 0.0, -gravity)), *loads])


def four_bar_of_nodes(count: int, EI: float, torque: float, crank: float) -> rj.Scene:
    """The four-bar with elements between nodes as its coupler."""
    one, other = sides(crank)
    placed, size = closed(crank), COUPLER / count
    nodes = []
    for i in range(count + 1):
        share = 0.5 * size * (1 if 0 < i < count else 0.5)
        place = placed.first + i / count * (placed.second - placed.first)
        turned = {"position": place, "angle": placed.coupler}
        nodes.append(rj.RigidBody(f"n{i}", share, ROTARY / 0.5 * share, **turned))
    stiffness = jnp.array([STIFF, STIFF, EI])
    elements = [
        Element(a=a.at(), b=b.at(), length=jnp.array(size), stiffness=stiffness)
        for a, b in itertools.pairwise(nodes)
    ]
    pins = [(one.at("end"), nodes[0].at()), (nodes[-1].at(), other.at("end"))]
    effects = [*loads(one, torque, 9.81), *elements]
    return rj.Scene([one, *nodes, other], held(one, other, pins), effects)


CASES = {
    "pendulum": Case(
        pendulum,
        1.0,
        "rod",
        "end",
        (
            {"angle": 0.5},
            {"angle": -0.8},
            {"angle": 0.2, "gravity": 12.0},
            {"force": 0.5},
            {"angle": -0.4, "force": -1.0},
        ),
    ),
    "four-bar": Case(
        four_bar,
        1.2,
        "coupler",
        "end",
        (
            {"crank": 1.2},
            {"crank": 2.0},
            {"torque": 0.8},
            {"torque": 1.4, "gravity": 8.0},
            {"torque": 1.0, "force": 1.0},
        ),
    ),
    "strip in space": Case(
        strip_in_space,
        1.0,
        "rod",
        "end",
        (
            {"angle": 0.5},
            {"angle": -0.8},
            {"angle": 0.2, "gravity": 12.0},
            {"side": 1.0},
            {"angle": -0.4, "force": -1.0},
        ),
        MANY + 4,
        ((4, 1e-3), (6, 2.5e-4), (8, 1e-3)),
    ),
}
