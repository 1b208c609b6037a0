"""Events and contacts of a ball that flies: what may be over within a step.

The truth of free flights and of impacts is a closed form. That of contacts is the same law of
force, written anew, by SciPy's DOP853 from the instant at which contact begins, which is a closed
form too.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import romjax as rj

from .kind import Kind, Numbers, moved, places, times
from .minimal import ATOL, GRAVITY, RTOL
from .planar import log


def ball(p: Numbers) -> rj.RigidBody:
    return rj.RigidBody("ball", p["mass"], p["mass"], position=p["x"], velocity=p["v"])


def watched(
    scene: Callable[[Numbers], rj.Scene],
    events: Callable[[Numbers, rj.Scene], Sequence[rj.AbstractEvent]],
    see: Callable[..., Any] = places,
) -> Callable[..., tuple[Any, rj.Trajectory]]:
    """What is seen of a run with events."""

    def move(p: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
        system = rj.assemble(made := scene(p))
        run = rj.simulate(system, times(p["end"]), events=events(p, made), **settings)
        return see(system, run), run

    return move


def numbers(**values: Any) -> Numbers:
    return {name: np.asarray(value, float) for name, value in values.items()}


# Past a post, or against it.


def draw_post(chance: np.random.Generator) -> Numbers:
    """A flight of one length, through a circle of 1e-4 to 1e-1 of it, by whatever speed."""
    length, angle = log(chance, 0.1, 100.0), chance.uniform(-3.0, 3.0)
    radius = length * log(chance, 1e-4, 1e-1)
    ahead, aside = length * chance.uniform(0.2, 0.8), radius * chance.uniform(-0.95, 0.95)
    way = np.array([np.cos(angle), np.sin(angle)])
    speed = log(chance, 0.1, 100.0)
    return numbers(
        mass=log(chance, 0.1, 10.0),
        x=chance.uniform(-1.0, 1.0, 2),
        v=speed * way,
        post=[ahead, aside],
        radius=radius,
        bounce=chance.uniform(0.0, 1.0),
        hardness=log(chance, 1e-3, 1e2),
        end=length / speed,
    )


def post_of(p: Numbers) -> Any:
    """Where the post is, from what is ahead of the ball and aside."""
    way = p["v"] / (p["v"] @ p["v"]) ** 0.5
    along, aside = p["post"][0], p["post"][1]
    xp = jnp if isinstance(p["v"], jax.Array) else np
    return p["x"] + along * way + aside * xp.stack([-way[1], way[0]])


def flight(p: Numbers, nudge: float) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Start, the time at which the ball comes to the circle, and place and normal there."""
    start = p["x"] + nudge * np.linalg.norm(p["v"]) * p["end"] / np.sqrt(2)
    way = start - post_of(p)
    a, b, c = p["v"] @ p["v"], way @ p["v"], way @ way - p["radius"] ** 2
    hit = c / (-b + np.sqrt(b**2 - a * c))
    there = start + hit * p["v"]
    return start, hit, there, (there - post_of(p)) / p["radius"]


def post_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    start, hit, there, normal = flight(p, nudge)
    after = p["v"] - (1 + p["bounce"]) * (normal @ p["v"]) * normal
    t = times(p["end"])[:, None]
    return np.where(t < hit, start + t * p["v"], there + (t - hit) * after)


def alone(p: Numbers) -> rj.Scene:
    return rj.Scene([ball(p)])


def posts(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    gap = rj.quantity.Gap(scene.bodies[0].at(), rj.ground.at(post_of(p)))
    return [rj.Impact(gap, p["bounce"], level=p["radius"])]


# A soft circle in the place of the post, with the force k δ^(3/2) at the depth R − r.


def stiffness(p: Numbers) -> Any:
    """Of a contact that stores about the "hardness" times the ball's energy at its depth."""
    return p["hardness"] * p["mass"] * (p["v"] @ p["v"]) / p["radius"] ** 2.5


def circle_scene(p: Numbers) -> rj.Scene:
    body = ball(p)
    at = rj.ground.at(post_of(p))
    contact = rj.Contact(body.at(), at, rj.Circle(p["radius"]), stiffness(p))
    return rj.Scene([body], effects=[contact])


def circle_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    start, hit, there, _ = flight(p, nudge)
    centre, k, ts = post_of(p), stiffness(p), times(p["end"])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        del t
        way = y[:2] - centre
        r = np.sqrt(way @ way)
        depth = max(p["radius"] - r, 0.0)
        return np.append(y[2:], k * depth**1.5 / p["mass"] * way / r)

    def leaves(t: float, y: np.ndarray) -> float:
        return float(np.linalg.norm(y[:2] - centre) - p["radius"] * (1 + 1e-12))

    leaves.terminal, leaves.direction = True, 1.0
    inside = ts[ts > hit]
    # In units of the circle, which is small.
    atol = ATOL * np.repeat([p["radius"], np.linalg.norm(p["v"])], 2)
    y0 = np.append(there, p["v"])
    first = min(0.01 * p["radius"] / np.linalg.norm(p["v"]), 0.5 * (p["end"] - hit))
    settings = {"rtol": RTOL, "atol": atol, "dense_output": True, "first_step": first}
    found = solve_ivp(rate, (hit, p["end"]), y0, "DOP853", events=leaves, **settings)
    out, last = found.t[-1], found.y[:, -1]
    before = start + ts[ts <= hit][:, None] * p["v"]
    at = inside[inside <= out]
    within = found.sol(at)[:2].T if len(at) else np.zeros((0, 2))
    after = last[:2] + (inside[inside > out] - out)[:, None] * last[2:]
    return np.concatenate([before, within, after])


# Bounces on the floor, of a ball thrown up.


def draw_bounces(chance: np.random.Generator) -> Numbers:
    """Some bounces, long before they end."""
    height, bounce = log(chance, 1e-3, 100.0), chance.uniform(0.3, 1.0)
    fall = np.sqrt(2 * height / GRAVITY)
    count = chance.integers(1, 7)
    whole = fall * (1 + 2 * np.sum(bounce ** np.arange(1, count)))
    return numbers(
        mass=log(chance, 0.1, 10.0),
        x=[0.0, height],
        v=[chance.uniform(-1.0, 1.0) * height / fall, 0.0],
        bounce=bounce,
        end=whole * chance.uniform(1.0, 1.0 + 0.5 * bounce**count / count),
    )


def bounces_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    ts, height = times(p["end"]), p["x"][1] * (1 + nudge)
    y, begin, speed, up = np.zeros_like(ts), 0.0, 0.0, height
    while begin < p["end"]:
        lasts = (speed + np.sqrt(speed**2 + 2 * GRAVITY * up)) / GRAVITY
        here = (ts >= begin) & (ts <= begin + lasts)
        t = ts[here] - begin
        y[here] = up + speed * t - GRAVITY / 2 * t**2
        speed, up, begin = p["bounce"] * (GRAVITY * lasts - speed), 0.0, begin + lasts
    return np.stack([p["x"][0] + ts * p["v"][0], y], axis=1)


def falling(p: Numbers) -> rj.Scene:
    return rj.Scene([ball(p)], effects=[rj.Gravity()])


def height_of(scene: rj.Scene) -> rj.quantity.Travel:
    return rj.quantity.Travel(scene.bodies[0].at(), rj.ground.at(angle=np.pi / 2))


def floor(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    return [rj.Impact(height_of(scene), p["bounce"])]


# Thrown up, past a level that is 1e-8 to 0.9 of its height below the highest place.


def draw_throw(chance: np.random.Generator) -> Numbers:
    height = log(chance, 0.1, 100.0)
    up = np.sqrt(2 * GRAVITY * height)
    return numbers(
        mass=log(chance, 0.1, 10.0),
        x=[0.0, 0.0],
        v=[chance.uniform(-1.0, 1.0) * up, up],
        level=height * (1 - log(chance, 1e-8, 0.9)),
        end=up / GRAVITY * chance.uniform(2.0, 3.0),
    )


def passages(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    """The times of both passages."""
    up = p["v"][1]
    root = np.sqrt(up**2 - 2 * GRAVITY * (p["level"] - nudge * up**2 / (2 * GRAVITY)))
    return (up + np.array([-root, root])) / GRAVITY


def crossings(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    return [rj.Crossing(height_of(scene), p["level"])]


def seen_passages(system: rj.AbstractSystem, run: rj.Trajectory) -> Any:
    """Both times, and by how many passages there are too many, in times of the run."""
    del system
    many = (run.events.count - 2) * run.t[-1]
    xp = jnp if isinstance(many, jax.Array) else np
    return xp.concatenate([run.events.time[:2], many[None]])[None]


def true_passages(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    return np.append(passages(p, nudge), 0.0)[None]


def stops(p: Numbers, scene: rj.Scene) -> list[rj.AbstractEvent]:
    return [rj.Stop(height_of(scene), p["level"])]


def stop_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    t = np.minimum(times(p["end"]), passages(p, nudge)[0])[:, None]
    return t * p["v"] - GRAVITY / 2 * t**2 * np.array([0.0, 1.0])


KINDS = {
    "thin post": Kind(draw_post, watched(alone, posts), post_motion),
    "soft circle": Kind(draw_post, moved(circle_scene), circle_motion),
    "bounces": Kind(draw_bounces, watched(falling, floor), bounces_motion),
    "crossings": Kind(draw_throw, watched(falling, crossings, seen_passages), true_passages),
    "stop": Kind(draw_throw, watched(falling, stops), stop_motion),
}
