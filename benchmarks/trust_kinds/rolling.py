"""What rolls, or moves along its edge alone: trailers, discs and balls.

The truth of trailers and discs is the motion in coordinates whose velocities are constrained, with
multipliers, by SciPy's DOP853; balls on a slope have a closed form.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import GRAVITY, Minimal
from .planar import along, bars, log, solid
from .spatial import InSpace, bodies, turn

r = rj.spatial


# A tractor and its trailer, each on an edge behind its middle; a spring turns them against each
# other. s = (x, y, φ, ψ).


def trailer_places(p: Numbers, t: Any, s: Any) -> Any:
    del t
    hitch = s[:2] - along(p["lengths"][0] / 2, s[2])
    return jnp.stack([s[:3], jnp.append(hitch - along(p["lengths"][1] / 2, s[3]), s[3])])


def trailer_slip(p: Numbers, s: Any, rate: Any) -> Any:
    """Of the edges, "arms" behind both middles, across both bodies."""
    found = []
    x, v = jax.jvp(lambda s: trailer_places(p, 0.0, s), (s,), (rate,))
    for i in range(2):
        across = jnp.stack([-jnp.sin(x[i, 2]), jnp.cos(x[i, 2])])
        found.append(v[i, :2] @ across - p["arms"][i] * v[i, 2])
    return jnp.stack(found)


def trailer_spring(p: Numbers, t: Any, s: Any, x: Any) -> Any:
    del t, x
    return 0.5 * p["stiffness"] * (s[3] - s[2]) ** 2 - p["pull"] * s[0]


TRAILER = Minimal(trailer_places, potential=trailer_spring, slip=trailer_slip)


def slipless(p: Numbers, slip: Any, ds: np.ndarray) -> np.ndarray:
    """The nearest rates that do not slip."""
    rows = np.asarray(jax.jacfwd(lambda v: slip(p, p["s"], v))(ds))
    return ds - np.linalg.pinv(rows) @ rows @ ds


def draw_trailer(chance: np.random.Generator) -> Numbers:
    p = solid(log(chance, 0.1, 10.0, 2), log(chance, 0.2, 2.0, 2))
    swing = np.sum(p["inertias"]) * log(chance, 0.3, 10.0) ** 2
    p |= {
        "arms": p["lengths"] * chance.uniform(0.1, 0.5, 2),
        "stiffness": np.asarray(swing * chance.choice([0.0, 1.0])),
        "pull": np.asarray(np.sum(p["masses"]) * chance.choice([0.0, 1.0])),
        "s": np.append(np.zeros(2), chance.uniform(-1.0, 1.0, 2)),
        "end": np.asarray(log(chance, 0.3, 3.0)),
    }
    return TRAILER.start({**p, "ds": slipless(p, trailer_slip, chance.uniform(-3.0, 3.0, 4))})


def trailer_scene(p: Numbers) -> rj.Scene:
    xp = np if isinstance(p["arms"], np.ndarray) else jnp
    both, none = bars(p), 0.0 * p["arms"][0]
    hitch = [
        body.at(xp.stack([h, none]))
        for body, h in zip(both, p["lengths"] / 2 * np.array([-1, 1]), strict=True)
    ]
    joints = [rj.Revolute(*hitch)]
    for i, body in enumerate(both):
        joints.append(rj.KnifeEdge(body.at(xp.stack([-p["arms"][i], none])), rj.ground.at()))
    effects = [
        rj.TorsionSpring(both[1].at(), both[0].at(), p["stiffness"]),
        rj.Force(both[0].at(), (1.0, 0.0), rj.Constant(p["pull"])),
    ]
    return rj.Scene(both, joints, effects)


# A disc on a plane of any direction, by x, y, yaw, lean and spin in its axes.


def disc_places(p: Numbers, t: Any, s: Any) -> Any:
    del t
    up, side = jnp.array([0.0, 0.0, 1.0]), jnp.array([1.0, 0.0, 0.0])
    frame = turn(up, s[2]) @ turn(side, s[3]) @ turn(up, s[4])
    place = jnp.append(s[:2], p["radius"] * jnp.sin(s[3]))
    plane = p["frame"]
    return jnp.concatenate([plane @ place, (plane @ frame).ravel()])[None]


def disc_slip(p: Numbers, s: Any, rate: Any) -> Any:
    """The velocity of the lowest point along both axes of the plane."""
    x, v = jax.jvp(lambda s: disc_places(p, 0.0, s)[0], (s,), (rate,))
    frame, turning = x[3:].reshape(3, 3), v[3:].reshape(3, 3)
    normal, axle = p["frame"][:, 2], frame[:, 2]
    upward = normal - normal @ axle * axle
    arm = -p["radius"] * upward / jnp.linalg.norm(upward)
    return p["frame"][:, :2].T @ (v[:3] + turning @ frame.T @ arm)


DISC = InSpace(disc_places, slip=disc_slip)


def draw_disc(chance: np.random.Generator) -> Numbers:
    radius, masses = log(chance, 0.01, 10.0), log(chance, 0.1, 10.0, 1)
    tilt = Rotation.from_rotvec(np.append(chance.uniform(-0.3, 0.3, 2), 0.0)).as_matrix()
    p = {
        "masses": masses,
        "moments": masses[:, None] * radius**2 * np.array([[0.25, 0.25, 0.5]]),
        "radius": np.asarray(radius),
        "frame": chance.choice([0.0, 1.0]) * (tilt - np.eye(3)) + np.eye(3),
        "s": np.concatenate([np.zeros(2), chance.uniform([-3, 1.2, -3], [3, 1.9, 3])]),
    }
    unit = np.sqrt(radius / GRAVITY)
    rates = np.concatenate([np.zeros(2), chance.uniform([-1, -0.2, -5], [1, 0.2, 5]) / unit])
    place = slipless({**p, "s": p["s"]}, disc_slip, rates)
    return DISC.start({**p, "ds": place, "end": np.asarray(unit * log(chance, 0.3, 3.0))})


def disc_scene(p: Numbers) -> rj.Scene:
    (disc,) = bodies(p)
    plane = rj.ground.at((0.0, 0.0, 0.0), axis=p["frame"][:, 2])
    rolls = r.RollingDisc(disc.at((0.0, 0.0, 0.0)), plane, p["radius"])
    return rj.Scene([disc], [rolls], [rj.Gravity((0.0, 0.0, -GRAVITY))])


# Balls on a slope: parabolas.


def draw_ball(chance: np.random.Generator) -> Numbers:
    radius, mass = log(chance, 1e-3, 10.0), log(chance, 0.1, 10.0)
    frame = Rotation.random(rng=chance).as_matrix()
    if frame[2, 2] < 0:
        frame = frame @ np.diag([1.0, -1.0, -1.0])
    speed = np.sqrt(radius) * chance.uniform(-3.0, 3.0, 2)
    turning = frame @ np.array([-speed[1], speed[0], 0.0]) / radius
    turning += frame[:, 2] * chance.uniform(-10.0, 10.0)
    p = {"mass": mass, "radius": radius, "share": chance.uniform(0.1, 0.67), "frame": frame}
    p |= {"speed": speed, "spin": turning, "end": np.sqrt(radius) * log(chance, 0.3, 5.0)}
    return {name: np.asarray(x) for name, x in p.items()}


def ball_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    frame, t = p["frame"], times(p["end"])[:, None]
    pull = np.array([0.0, 0.0, -GRAVITY]) @ frame[:, :2] / (1 + p["share"])
    way = p["speed"] * t * (1 + nudge) + pull * t**2 / 2
    return way @ frame[:, :2].T + p["radius"] * frame[:, 2]


def ball_scene(p: Numbers) -> rj.Scene:
    frame, mass, radius = p["frame"], p["mass"], p["radius"]
    ball = r.RigidBody(
        "ball",
        mass,
        p["share"] * mass * radius**2 * np.ones(3),
        position=radius * frame[:, 2],
        velocity=frame[:, :2] @ p["speed"],
        angular_velocity=p["spin"],
    )
    plane = rj.ground.at((0.0, 0.0, 0.0), axis=frame[:, 2])
    rolls = r.RollingBall(ball.at((0.0, 0.0, 0.0)), plane, radius)
    return rj.Scene([ball], [rolls], [rj.Gravity((0.0, 0.0, -GRAVITY))])


KINDS = {
    "trailer": Kind(draw_trailer, moved(trailer_scene), TRAILER.motion),
    "rolling disc": Kind(draw_disc, moved(disc_scene), DISC.motion),
    "rolling ball": Kind(draw_ball, moved(ball_scene), ball_motion),
}
