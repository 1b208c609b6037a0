"""Bodies that tumble, many times within a step of free flight: contacts, ropes, events, impacts.

In the plane a free turn is exact. In space its speed drifts from step to step, and errors of the
angle grow with the square of the turns, for which steps allow by the angular velocity of the start:
bodies turn up to three times there before they strike, and up to thirty times in kinds of their
own.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import romjax as rj

from .events import numbers, watched
from .flights import FLOOR, ROPE, Law, Z, motion, passages, start
from .kind import Kind, Numbers, moved
from .planar import log
from .spatial import axes

r = rj.spatial
EVENTS = 256  # passages
UP = np.array([0.0, 1.0, 0.0])


def draw(
    flat: bool, power: float = 1.5, turns: float = 30.0, most: float = 30.0
) -> Callable[[np.random.Generator], Numbers]:
    """A tip comes to a level after half a turn to so many turns, from up to `most` arms."""

    def of(chance: np.random.Generator) -> Numbers:
        arm, spin, mass = log(chance, 1e-3, 10.0), log(chance, 10.0, 1e3), log(chance, 0.1, 10.0)
        flight = 2 * np.pi * log(chance, 0.5, turns) / spin
        far, whole = arm * log(chance, 1.1, most), chance.choice([0.0, 0.5, 1.0])
        angle, share = chance.uniform(-np.pi, np.pi), chance.uniform(0.2, 0.6)
        way = Rotation.from_rotvec(angle * Z) if flat else Rotation.random(rng=chance)
        return numbers(
            mass=mass,
            # The first two are equal.
            moments=mass * arm**2 * share * np.array([1.0, 1.0, chance.uniform(0.1, 1.9)]),
            tip=arm * np.array([1.0, 0.0, 0.0]) if flat else arm * axes(chance, 1)[0],
            turn=way.as_quat(scalar_first=True),
            x=[0.0, far, 0.0],
            v=far / flight * np.array([chance.uniform(-0.3, 0.3), whole - 1, 0.0]),
            down=2 * whole * far / flight**2,
            spin=spin * (chance.choice([-1.0, 1.0]) * Z if flat else axes(chance, 1)[0]),
            k=mass * spin**2 * arm ** (1 - power) * log(chance, 30.0, 1e5),
            loss=chance.choice([0.0, log(chance, 1e-2, 0.5)]) / (arm * spin),
            bounce=chance.uniform(0.3, 1.0),
            end=flight * chance.uniform(0.9, 1.2),
        )

    return of


def flat(of: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """In the plane."""
    return lambda p, nudge=0.0: of(p, nudge)[:, :2]


def truly_seen(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    """As `seen`."""
    found = list(passages(p, FLOOR, start(p, nudge), float(p["end"])))
    return np.append(found + [0.0] * (EVENTS - len(found)), (1 + len(found)) * p["end"])[None]


def stick(p: Numbers) -> rj.RigidBody:
    w, *_, z = p["turn"]
    xp = jnp if isinstance(p["turn"], jax.Array) else np
    return rj.RigidBody(
        "stick",
        p["mass"],
        p["moments"][2],
        position=p["x"][:2],
        angle=2 * xp.arctan2(z, w),
        velocity=p["v"][:2],
        angular_velocity=p["spin"][2],
    )


def box(p: Numbers) -> r.RigidBody:
    return r.RigidBody(
        "box",
        p["mass"],
        p["moments"],
        position=p["x"],
        orientation=p["turn"],
        velocity=p["v"],
        angular_velocity=p["spin"],
    )


def scene_of(flat: bool, law: Law | None = None) -> Callable[[Numbers], rj.Scene]:
    def scene(p: Numbers) -> rj.Scene:
        body, size = (stick(p), 2) if flat else (box(p), 3)
        tip, more = body.at(p["tip"][:size]), {"dissipation": p["loss"]}
        effects: list[Any] = [rj.Gravity(-p["down"] * UP[:size])]
        if law is ROPE:
            hook = rj.ground.at(2 * p["x"][:size])
            effects.append(rj.Rope(tip, hook, 2 * p["x"][1], p["k"], **more))
        elif law and flat:
            effects.append(rj.Contact(tip, rj.ground.at(), rj.Line(), p["k"], **more))
        elif law:
            level = rj.ground.at(np.zeros(3), axis=UP)
            effects.append(r.Contact(tip, level, r.Plane(), p["k"], **more))
        return rj.Scene([body], effects=effects)

    return scene


def height(p: Numbers, scene: rj.Scene) -> rj.quantity.Travel:
    """Of the tip."""
    (body,) = scene.bodies
    if isinstance(body, r.RigidBody):
        upright = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return rj.quantity.Travel(
            body.at(p["tip"]), rj.ground.at((0.0, 0.0, 0.0), rotation=upright)
        )
    return rj.quantity.Travel(body.at(p["tip"][:2]), rj.ground.at(angle=np.pi / 2))


def crossings(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    return [rj.Crossing(height(p, scene))]


def impacts(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    return [rj.Impact(height(p, scene), p["bounce"])]


def seen(system: rj.AbstractSystem, run: rj.Trajectory) -> Any:
    """The times of passages, and how many and one, in times of the run."""
    del system
    count, found = run.events.count, run.events.time[:EVENTS]
    xp = jnp if isinstance(count, jax.Array) else np
    found = xp.where(np.arange(EVENTS) < count, found, 0.0)
    return xp.append(found, (1 + count) * run.t[-1])[None]


FLAT, SOLID = scene_of(True), scene_of(False)
KINDS = {
    f"tumbling, {name}": kind
    for name, kind in {
        "floor": Kind(draw(True), moved(scene_of(True, FLOOR)), flat(motion(FLOOR))),
        "rope": Kind(draw(True, 1.0), moved(scene_of(True, ROPE)), flat(motion(ROPE))),
        "impacts": Kind(draw(True), watched(FLAT, impacts), flat(motion(FLOOR, True))),
        "crossings": Kind(draw(True, most=300.0), watched(FLAT, crossings, seen), truly_seen),
        "floor, space": Kind(draw(False, turns=3.0), moved(scene_of(False, FLOOR)), motion(FLOOR)),
        "rope, space": Kind(draw(False, 1.0, 3.0), moved(scene_of(False, ROPE)), motion(ROPE)),
        "impacts, space": Kind(
            draw(False, turns=3.0), watched(SOLID, impacts), motion(FLOOR, True)
        ),
        "crossings, space": Kind(
            draw(False, most=300.0), watched(SOLID, crossings, seen), truly_seen
        ),
        "floor, far in space": Kind(draw(False), moved(scene_of(False, FLOOR)), motion(FLOOR)),
        "rope, far in space": Kind(draw(False, 1.0), moved(scene_of(False, ROPE)), motion(ROPE)),
        "impacts, far in space": Kind(draw(False), watched(SOLID, impacts), motion(FLOOR, True)),
    }.items()
}
