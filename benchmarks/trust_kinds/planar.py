"""Planar mechanisms of rigid bars: open chains, closed loops, and loops that are driven.

The truth of all is their motion in minimal coordinates by SciPy's DOP853 (`minimal.py`).
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved
from .minimal import Minimal


def log(chance: np.random.Generator, low: float, high: float, shape: Any = ()) -> Any:
    """Numbers whose logarithm is uniform."""
    return np.exp(chance.uniform(np.log(low), np.log(high), shape))


def bars(p: Numbers) -> list[rj.RigidBody]:
    """Bars at the places and with the velocities of the start."""
    count = p["masses"].shape[0]
    return [
        rj.RigidBody(
            f"bar{i}",
            p["masses"][i],
            p["inertias"][i],
            position=p["x"][i, :2],
            angle=p["x"][i, 2],
            velocity=p["v"][i, :2],
            angular_velocity=p["v"][i, 2],
        )
        for i in range(count)
    ]


def ends(bar: rj.RigidBody, length: Any) -> tuple[rj.Marker, rj.Marker]:
    """Markers at both ends of a bar along its x axis."""
    half, xp = length / 2, np if isinstance(length, float | np.ndarray) else jnp
    none = 0.0 * half
    return bar.at(xp.stack([-half, none])), bar.at(xp.stack([half, none]))


def along(length: Any, angle: Any) -> Any:
    return length * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def pieces(points: Any) -> Any:
    """Places of bars between successive pairs of points."""
    rows = []
    for start, end in points:
        way = end - start
        rows.append(jnp.append((start + end) / 2, jnp.arctan2(way[1], way[0])))
    return jnp.stack(rows)


def solid(masses: Any, lengths: Any) -> Numbers:
    """Masses, lengths and moments of inertia of uniform bars."""
    return {"masses": masses, "lengths": lengths, "inertias": masses * lengths**2 / 12}


# Open chains.


def chain_places(p: Numbers, t: Any, s: Any) -> Any:
    """Bars end to end from the origin, by their angles."""
    del t
    rows, point = [], jnp.zeros(2)
    for i in range(len(s)):
        way = along(p["lengths"][i], s[i])
        rows.append(jnp.append(point + way / 2, s[i]))
        point = point + way
    return jnp.stack(rows)


CHAINS = {count: Minimal(chain_places) for count in (1, 3)}


def draw_chain(chance: np.random.Generator, count: int) -> Numbers:
    numbers = solid(log(chance, 0.1, 10.0, count), log(chance, 0.1, 3.0, count))
    start = {"s": chance.uniform(-3.0, 3.0, count), "ds": chance.uniform(-4.0, 4.0, count)}
    return CHAINS[count].start({**numbers, **start, "end": log(chance, 0.2, 3.0)})


def chain_scene(p: Numbers) -> rj.Scene:
    links, joints, at = bars(p), [], rj.ground.at()
    for i, link in enumerate(links):
        start, end = ends(link, p["lengths"][i])
        joints.append(rj.Revolute(start, at))
        at = end
    return rj.Scene(links, joints, [rj.Gravity()])


def chain(count: int) -> Kind:
    return Kind(lambda chance: draw_chain(chance, count), moved(chain_scene), CHAINS[count].motion)


# Four bars, whose crank may go round.


def four_bar_points(p: Numbers, angle: Any) -> Any:
    """Both ends of crank, coupler and rocker: the third joint is where two circles meet."""
    crank, coupler, rocker, base = (p["lengths"][i] for i in range(4))
    origin, far = jnp.zeros(2), jnp.stack([base, 0.0 * base])
    knee = along(crank, angle)
    way = far - knee
    span = jnp.linalg.norm(way)
    forward = (coupler**2 - rocker**2 + span**2) / (2 * span)
    up = jnp.sqrt(coupler**2 - forward**2)
    top = knee + (forward * way + up * jnp.stack([-way[1], way[0]])) / span
    return (origin, knee), (knee, top), (far, top)


def four_bar_places(p: Numbers, t: Any, s: Any) -> Any:
    del t
    return pieces(four_bar_points(p, s[0]))


FOUR_BAR = Minimal(four_bar_places)


def grashof(chance: np.random.Generator) -> np.ndarray:
    """Lengths of crank, coupler, rocker and base with which the crank, the shortest, goes round."""
    while True:
        crank, others = chance.uniform(0.1, 0.8), chance.uniform(0.5, 2.0, 3)
        least, most = np.min(others), np.max(others)
        if crank < 0.9 * least and crank + most < 0.98 * (np.sum(others) - most):
            return np.array([crank, *others])


def draw_four_bar(chance: np.random.Generator) -> Numbers:
    lengths = grashof(chance)
    numbers = solid(log(chance, 0.1, 10.0, 3), lengths[:3]) | {"lengths": lengths}
    start = {"s": chance.uniform(-3.0, 3.0, 1), "ds": chance.uniform(-15.0, 15.0, 1)}
    return FOUR_BAR.start({**numbers, **start, "end": log(chance, 0.2, 4.0)})


def four_bar_joints(p: Numbers, links: list[rj.RigidBody]) -> list[rj.AbstractJoint]:
    xp = np if isinstance(p["lengths"], np.ndarray) else jnp
    far = rj.ground.at(xp.stack([p["lengths"][3], 0.0 * p["lengths"][3]]))
    crank, coupler, rocker = (ends(link, p["lengths"][i]) for i, link in enumerate(links))
    return [
        rj.Revolute(crank[0], rj.ground.at()),
        rj.Revolute(coupler[0], crank[1]),
        rj.Revolute(rocker[0], far),
        rj.Revolute(rocker[1], coupler[1]),
    ]


def four_bar_scene(p: Numbers, twice: bool = False) -> rj.Scene:
    """With `twice`, the pin between coupler and rocker is made twice."""
    links = bars(p)
    joints = four_bar_joints(p, links)
    again = [rj.Revolute(joints[3].a, joints[3].b, name="again")] if twice else []
    return rj.Scene(links, [*joints, *again], [rj.Gravity()])


def four_bar(twice: bool) -> Kind:
    return Kind(draw_four_bar, moved(lambda p: four_bar_scene(p, twice)), FOUR_BAR.motion)


# Parallelograms, which pass singular positions.


def parallelogram_places(p: Numbers, t: Any, s: Any) -> Any:
    """Crank, coupler and rocker; where there is a fourth mass, a third crank in between."""
    del t
    way, base = along(p["lengths"][0], s[0]), jnp.stack([p["lengths"][1], 0.0 * s[0]])
    first, rocker, more = (jnp.append(x * base + way / 2, s[0]) for x in (0.0, 1.0, p["share"]))
    coupler = jnp.append(way + base / 2, 0.0)
    return jnp.stack([first, coupler, rocker, more][: len(p["masses"])])


PARALLELOGRAMS = {count: Minimal(parallelogram_places) for count in (3, 4)}


def draw_parallelogram(chance: np.random.Generator, count: int) -> Numbers:
    crank, base = chance.uniform(0.3, 1.5), chance.uniform(0.5, 2.5)
    lengths = np.array([crank, base, crank, crank])[:count]
    start = {"s": chance.uniform(-3.0, 3.0, 1), "ds": chance.uniform(-12.0, 12.0, 1)}
    numbers = solid(log(chance, 0.1, 10.0, count), lengths) | start
    numbers |= {"share": np.asarray(chance.uniform(0.2, 0.8)), "end": log(chance, 0.2, 4.0)}
    return PARALLELOGRAMS[count].start(numbers)


def parallelogram_scene(p: Numbers) -> rj.Scene:
    """A third crank repeats a constraint, and then no position is singular."""
    links, base = bars(p), p["lengths"][1]
    xp = np if isinstance(p["lengths"], np.ndarray) else jnp
    crank, coupler, rocker, *more = (ends(link, p["lengths"][i]) for i, link in enumerate(links))
    joints = [
        rj.Revolute(crank[0], rj.ground.at()),
        rj.Revolute(coupler[0], crank[1]),
        rj.Revolute(rocker[0], rj.ground.at(xp.stack([base, 0.0 * base]))),
        rj.Revolute(rocker[1], coupler[1]),
    ]
    for start, end in more:
        on_base = xp.stack([p["share"] * base, 0.0 * base])
        on_coupler = xp.stack([(p["share"] - 0.5) * base, 0.0 * base])
        joints += [
            rj.Revolute(start, rj.ground.at(on_base)),
            rj.Revolute(end, links[1].at(on_coupler)),
        ]
    return rj.Scene(links, joints, [rj.Gravity()])


def parallelogram(count: int) -> Kind:
    return Kind(
        lambda chance: draw_parallelogram(chance, count),
        moved(parallelogram_scene),
        PARALLELOGRAMS[count].motion,
    )


KINDS = {
    "pendulum": chain(1),
    "chain of three": chain(3),
    "four-bar": four_bar(twice=False),
    "four-bar, pinned twice": four_bar(twice=True),
    "parallelogram": parallelogram(3),
    "three cranks": parallelogram(4),
}
