"""Mechanisms to reduce: each with starts or numbers to train with, and others to predict."""

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
import meshed_arm
import meshed_crank
import numpy as np
from linkages import five_bar, four_bar

import romjax as rj

HELD_OUT = 10  # starts or sets of numbers that no snapshot is from
EXPLICIT = (diffrax.Tsit5(), diffrax.Dopri8())


class Case(NamedTuple):
    """`scene(**numbers)`, simulated for `end` [s]; without numbers it is the one of the training.

    - `others`: what is held out, numbers for `scene`, with "spin" [rad/s] and "tilt" [rad] about
      the origin.
    - `models`: a formulation with its rank, as (name, rank), or ("cap", hertz).
    - `truth`: method and relative tolerance of the runs that errors are measured by.
    - `full`, `reduced`: the methods that are tried on the full model and on the reduced ones.
    """

    scene: Callable[..., rj.Scene]
    end: float
    others: tuple[dict[str, float], ...]
    models: tuple[tuple[str, int], ...]
    truth: tuple[diffrax.AbstractSolver, float] = (diffrax.Dopri8(), 1e-10)
    full: tuple[diffrax.AbstractSolver, ...] = (rj.Rodas5P(), *EXPLICIT)
    reduced: tuple[diffrax.AbstractSolver, ...] = EXPLICIT

    def system(self, cap: float | None = None, **numbers: float) -> rj.AbstractSystem:
        """The full system, or with capped modes, at the start of these numbers."""
        spin, tilt = numbers.pop("spin", 0.0), numbers.pop("tilt", 0.0)
        scene = self.scene(**numbers)
        system = rj.assemble(scene if cap is None else rj.cap(scene, cap))
        if not (spin or tilt):
            return system
        q, v = moved(system, spin, tilt)
        return dataclasses.replace(system, q0=q, v0=v)


def moved(system: Any, spin: float, tilt: float) -> tuple[Any, Any]:
    """The start of a system, turned about the origin, and turning about it."""
    q, v = np.array(system.q0), np.array(system.v0)
    c, s = np.cos(tilt), np.sin(tilt)
    frames = np.array([own[:3] for group in system.bodies for own in group.coordinates.rows])
    x, y, angle = frames.T
    q[x], q[y] = c * q[x] - s * q[y], s * q[x] + c * q[y]
    q[angle] += tilt
    v[x], v[y], v[angle] = v[x] - spin * q[y], v[y] + spin * q[x], v[angle] + spin
    return jnp.asarray(q), jnp.asarray(v)


def turned() -> Iterator[dict[str, float]]:
    """Spins and tilts of both signs, alone and together."""
    for spin, tilt in itertools.product((-1.0, 0.0, 1.0), (-0.52, 0.0, 0.52)):
        if spin or tilt:
            yield {"spin": spin, "tilt": tilt}
    yield {"spin": 0.05, "tilt": 0.0}
    yield {"spin": 0.3, "tilt": -0.2}


def driven() -> Iterator[dict[str, float]]:
    """Numbers of the chapter's example from a box, by a seed."""
    lot = np.random.default_rng(0)
    for _ in range(HELD_OUT):
        force, frequency, f1 = lot.uniform((5.0, 8.0, 14.0), (15.0, 12.0, 18.0))
        yield {"force": force, "frequency": frequency, "f1": f1}


def heavier() -> Iterator[dict[str, float]]:
    """A four-bar with other masses of its coupler [kg]."""
    for coupler in np.geomspace(0.4, 2.5, HELD_OUT):
        yield {"coupler": float(coupler)}


def hanging() -> Iterator[dict[str, float]]:
    """A five-bar with other masses [kg] and springs [N/m], by a seed."""
    lot = np.random.default_rng(2)
    for _ in range(HELD_OUT):
        rod, spring = lot.uniform((0.8, 54.0), (1.2, 66.0))
        yield {"rod": rod, "spring": spring}


def beams(count: int) -> rj.Scene:
    """Beams of 1 m and 1 kg with three modes, hinged end to end, falling from the level."""
    bodies = [
        rj.Beam(f"beam{i}", mass=1.0, length=1.0, frequencies=[30.0, 80.0, 150.0], position=(i, 0))
        for i in np.arange(count) + 0.5
    ]
    return rj.Scene(bodies, _hinges(bodies, 0.5), [rj.Gravity()])


def segments(count: int, mass: float = 1.0, EI: float = 1.0) -> rj.Scene:
    """A beam of 1 m, in kg and N m², as bars that are hinged by springs, falling from the level."""
    size, own = 1 / count, mass / count
    bodies = [
        rj.RigidBody(f"bar{i}", own, own * size**2 / 12, (x, 0.0), extent=(size, 0.01))
        for i, x in enumerate((np.arange(count) + 0.5) * size)
    ]
    bending = [
        rj.TorsionSpring(b.at((-size / 2, 0.0)), a.at((size / 2, 0.0)), stiffness=count * EI)
        for a, b in itertools.pairwise(bodies)
    ]
    return rj.Scene(bodies, _hinges(bodies, size / 2), [rj.Gravity(), *bending])


def _hinges(bodies: list[Any], half: float) -> list[rj.Revolute]:
    """The first body on the ground, each other one on the one before."""
    hinges = [rj.ground.at(), *(body.at((half, 0.0)) for body in bodies)]
    return [
        rj.Revolute(body.at((-half, 0.0)), hinge)
        for body, hinge in zip(bodies, hinges, strict=False)
    ]


CASES = {
    "cart-pendulum": Case(
        rj.gallery.cart_pendulum,
        1.0,
        tuple(driven()),
        (("galerkin", 4), ("galerkin", 5), ("minimal", 3), ("local", 1), ("cap", 40)),
    ),
    "four-bar": Case(
        four_bar, 5.0, tuple(heavier()), (("galerkin", 7), ("minimal", 1), ("table", 1))
    ),
    "five-bar": Case(five_bar, 5.0, tuple(hanging()), (("minimal", 2), ("table", 2))),
    "8 beams": Case(
        lambda: beams(8),
        1.0,
        tuple(turned()),
        (
            ("galerkin", 40),
            ("minimal", 8),
            ("minimal", 16),
            ("local", 8),
            ("local", 16),
            ("cap", 45),
        ),
    ),
    "32 segments": Case(
        lambda: segments(32),
        1.0,
        tuple(turned()),
        (("minimal", 4), ("minimal", 6), ("hyper", 4), ("hyper", 6)),
    ),
    "robot arm": Case(
        meshed_arm.meshed_arm,
        0.5,
        tuple(meshed_arm.moves(HELD_OUT)),
        (("local", 6), ("local", 10)),
        # Explicit methods would need far too many steps for its fastest modes.
        truth=(rj.Rodas5P(), 1e-9),
        full=(rj.Rodas5P(),),
        reduced=(rj.Rodas5P(), diffrax.Dopri8()),
    ),
    "meshed slider crank": Case(
        meshed_crank.meshed_crank,
        0.03,
        tuple(meshed_crank.driven(HELD_OUT)),
        (("local", 1), ("local", 2), ("local", 4)),
    ),
}
