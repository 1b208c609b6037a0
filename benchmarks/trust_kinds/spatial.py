"""Mechanisms of rigid bodies in space: chains of hinges, and loops.

The truth is their motion in minimal coordinates by SciPy's DOP853 (`minimal.py`), with rotation
matrices instead of quaternions.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import GRAVITY, Minimal
from .planar import FOUR_BAR, draw_four_bar, log

r = rj.spatial
DOWN = (0.0, 0.0, -GRAVITY)


def axes(chance: np.random.Generator, count: int) -> np.ndarray:
    """Directions (count, 3)."""
    found = chance.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def moments(chance: np.random.Generator, masses: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Principal moments of boxes whose edges are some share of a size (count, 3)."""
    edges = sizes[:, None] * chance.uniform(0.1, 1.0, (len(masses), 3))
    squares = edges**2
    return masses[:, None] / 12 * (np.sum(squares, axis=1, keepdims=True) - squares)


def turn(axis: Any, angle: Any) -> Any:
    """The rotation matrix about a direction."""
    x, y, z = axis
    cross = jnp.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return jnp.eye(3) + jnp.sin(angle) * cross + (1 - jnp.cos(angle)) * cross @ cross


def energy(p: Numbers, x: Any, rate: Any) -> Any:
    """½ Σ m |ẋ|² + tr(Ṙ K Ṙᵀ), K = ½ tr(J) 1 − J; rows are x, then R."""
    del x
    turning = rate[:, 3:].reshape(-1, 3, 3)
    total = jnp.sum(p["moments"], axis=1, keepdims=True)
    spread = jnp.sum(turning**2, axis=1) * (total / 2 - p["moments"])
    return 0.5 * (jnp.sum(p["masses"][:, None] * rate[:, :3] ** 2) + jnp.sum(spread))


def weight(p: Numbers, t: Any, s: Any, x: Any) -> Any:
    del t, s
    return GRAVITY * jnp.sum(p["masses"] * x[:, 2])


class InSpace(Minimal):
    """With rows of positions and rotation matrices."""

    def __init__(self, positions: Any, **settings: Any):
        super().__init__(positions, energy, weight, columns=(0, 1, 2), **settings)

    def start(self, p: Numbers) -> Numbers:
        """The same numbers with "x" of the positions, "turns" (w, x, y, z), "v" and "spins"."""
        both = super().start(p)
        x, v = both["x"], both["v"]
        matrices, rates = x[:, 3:].reshape(-1, 3, 3), v[:, 3:].reshape(-1, 3, 3)
        spin = rates @ matrices.transpose(0, 2, 1)
        spins = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        turns = Rotation.from_matrix(matrices).as_quat(scalar_first=True)
        return {**p, "x": x[:, :3], "v": v[:, :3], "turns": turns, "spins": spins}

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        own = {name: value for name, value in p.items() if name not in ("turns", "spins")}
        return super().motion(own, nudge)


def bodies(p: Numbers) -> list[r.RigidBody]:
    return [
        r.RigidBody(
            f"body{i}",
            p["masses"][i],
            p["moments"][i],
            position=p["x"][i],
            orientation=p["turns"][i],
            velocity=p["v"][i],
            angular_velocity=p["spins"][i],
        )
        for i in range(p["masses"].shape[0])
    ]


# Chains of hinges: from the hinge to the centre "arms", from there to the next one "tips", each
# about one of the "axes", by the axes of the body.


def chain_places(p: Numbers, t: Any, s: Any) -> Any:
    del t
    rows, point, frame = [], jnp.zeros(3), jnp.eye(3)
    for i in range(len(s)):
        frame = frame @ turn(p["axes"][i], s[i])
        centre = point + frame @ p["arms"][i]
        rows.append(jnp.concatenate([centre, frame.ravel()]))
        point = centre + frame @ p["tips"][i]
    return jnp.stack(rows)


CHAIN = InSpace(chain_places)


def draw_chain(chance: np.random.Generator) -> Numbers:
    masses, sizes = log(chance, 0.1, 10.0, 3), log(chance, 0.2, 2.0, 3)
    half = sizes[:, None] / 2
    numbers = {
        "masses": masses,
        "moments": moments(chance, masses, sizes),
        "arms": half * axes(chance, 3),
        "tips": half * axes(chance, 3),
        "axes": axes(chance, 3),
        "s": chance.uniform(-3.0, 3.0, 3),
        "ds": chance.uniform(-4.0, 4.0, 3),
        "end": np.asarray(log(chance, 0.2, 2.0)),
    }
    return CHAIN.start(numbers)


def chain_scene(p: Numbers) -> rj.Scene:
    links, joints = bodies(p), []
    for i, link in enumerate(links):
        axis = p["axes"][i]
        last = links[i - 1].at(p["tips"][i - 1], axis=axis) if i else None
        at = rj.ground.at((0.0, 0.0, 0.0), axis=axis) if last is None else last
        joints.append(r.Revolute(link.at(-p["arms"][i], axis=axis), at))
    return rj.Scene(links, joints, [rj.Gravity(DOWN)])


# A loop: two hinged levers whose tips a rod joins.


def lever(p: Numbers, row: int, angle: Any) -> Any:
    """Position and rotation of a lever, and its tip."""
    frame = p["frames"][row] @ turn(jnp.array([0.0, 0.0, 1.0]), angle)
    arm = frame[:, 0] * p["lengths"][row]
    centre = p["feet"][row] + arm / 2
    return jnp.concatenate([centre, frame.ravel()]), p["feet"][row] + arm


def levers_places(p: Numbers, t: Any, s: Any) -> Any:
    """The second angle is such that the rod has its length: a cos ψ + b sin ψ = c."""
    del t
    first, tip = lever(p, 0, s[0])
    way, size = p["feet"][1] - tip, p["lengths"][1]
    a, b = (2 * size * way @ p["frames"][1][:, i] for i in range(2))
    c = p["rod"] ** 2 - way @ way - size**2
    angle = jnp.arctan2(b, a) + jnp.arccos(c / jnp.sqrt(a**2 + b**2))
    return jnp.stack([first, lever(p, 1, angle)[0]])


LEVERS = InSpace(levers_places)
_turned = jax.jit(lambda p, angles: jax.vmap(lambda s: levers_places(p, 0.0, s[None]))(angles))


def draw_levers(chance: np.random.Generator) -> Numbers:
    """Levers of which the first can go round."""
    round_ = np.linspace(0.0, 2 * np.pi, 60)
    while True:
        masses, sizes = log(chance, 0.1, 10.0, 2), chance.uniform([0.1, 0.6], [0.5, 1.5])
        p = {
            "masses": masses,
            "moments": moments(chance, masses, sizes),
            "lengths": sizes,
            "feet": np.stack([np.zeros(3), chance.uniform(0.3, 1.5) * axes(chance, 1)[0]]),
            "frames": Rotation.random(2, rng=chance).as_matrix(),
            "rod": np.asarray(chance.uniform(0.5, 2.0)),
        }
        found = np.asarray(_turned(p, round_))
        # Where the arc cosine is steep, both levers cannot go on.
        if np.isfinite(found).all() and np.max(np.abs(np.diff(found, axis=0))) < 0.25:
            break
    start = {"s": chance.uniform(-3.0, 3.0, 1), "ds": chance.uniform(-15.0, 15.0, 1)}
    return LEVERS.start({**p, **start, "end": np.asarray(log(chance, 0.2, 3.0))})


def levers_scene(p: Numbers) -> rj.Scene:
    both, joints, tips = bodies(p), [], []
    up = np.array([0.0, 0.0, 1.0])
    for i, body in enumerate(both):
        half = p["lengths"][i] / 2 * np.array([1.0, 0.0, 0.0])
        foot = rj.ground.at(p["feet"][i], axis=p["frames"][i][:, 2])
        joints.append(r.Revolute(body.at(-half, axis=up), foot))
        tips.append(body.at(half))
    joints.append(rj.Distance(*tips, p["rod"]))
    return rj.Scene(both, joints, [rj.Gravity(DOWN)])


# A planar four-bar with hinges in space, whose constraints repeat each other, in a turned frame.


def draw_flat(chance: np.random.Generator) -> Numbers:
    return {**draw_four_bar(chance), "frame": Rotation.random(rng=chance).as_matrix()}


def flat_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    own = {name: value for name, value in p.items() if name != "frame"}
    flat = FOUR_BAR.motion(own, nudge).reshape(len(times(p["end"])), 3, 2)
    return (flat @ p["frame"][:, :2].T).reshape(len(flat), -1)


def flat_scene(p: Numbers) -> rj.Scene:
    frame, links = p["frame"], []
    xp = jnp if isinstance(frame, jax.Array) else np
    normal = frame[:, 2]
    for i in range(3):
        c, s, none = xp.cos(p["x"][i, 2]), xp.sin(p["x"][i, 2]), 0.0 * p["x"][i, 2]
        flat = xp.stack(
            [xp.stack([c, -s, none]), xp.stack([s, c, none]), xp.stack([none] * 2 + [1.0 + none])]
        )
        links.append(
            r.RigidBody(
                f"bar{i}",
                p["masses"][i],
                p["inertias"][i] * np.array([0.1, 1.0, 1.0]),
                position=frame[:, :2] @ p["x"][i, :2],
                orientation=frame @ flat,
                velocity=frame[:, :2] @ p["v"][i, :2],
                angular_velocity=p["v"][i, 2] * normal,
            )
        )
    up = np.array([0.0, 0.0, 1.0])

    def end(i: int, side: float) -> rj.Marker:
        return links[i].at(side * p["lengths"][i] / 2 * np.array([1.0, 0.0, 0.0]), axis=up)

    far = rj.ground.at(p["lengths"][3] * frame[:, 0], axis=normal)
    pairs = [
        (end(0, -1), rj.ground.at((0.0, 0.0, 0.0), axis=normal)),
        (end(1, -1), end(0, 1)),
        (end(2, -1), far),
        (end(2, 1), end(1, 1)),
    ]
    joints = [r.Revolute(a, b) for a, b in pairs]
    return rj.Scene(links, joints, [rj.Gravity(-GRAVITY * frame[:, 1])])


KINDS = {
    "chain in space": Kind(draw_chain, moved(chain_scene), CHAIN.motion),
    "levers in space": Kind(draw_levers, moved(levers_scene), LEVERS.motion),
    "four-bar in space": Kind(draw_flat, moved(flat_scene), flat_motion),
}
