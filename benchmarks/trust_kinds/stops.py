"""What begins at a length or an angle: stops of hinges and slides, which are grazed or struck, and
ropes that slacken. Sensitivity is that to the start moved, and faster.

The truth is the same law of force, k δ (1 + D δ'), written anew, by SciPy's DOP853, whose steps end
where the law begins, where it ends, and where the depth is largest.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import romjax as rj

from .events import ball, numbers
from .joints import in_joints
from .kind import Kind, Numbers, moved, times
from .minimal import GRAVITY
from .planar import bars, ends, log, solid
from .spatial import DOWN, axes, moments

RTOL, ATOL = 1e-12, 1e-14
FAR = -50.0  # where a stop is that is never reached
MOST = 20000  # times that a law begins, ends or turns

# The room before each stop of one motion, and its rate.
Gaps = Callable[[Sequence[float]], list[tuple[float, float]]]
# That of a state, under the pushes of the stops.
Rate = Callable[[Sequence[float], list[float]], list[float]]


def struck(p: Numbers, ts: np.ndarray, y: np.ndarray, gaps: Gaps, rate: Rate) -> np.ndarray:
    """States (k, n) at the times `ts`; within a step each law is held to one side."""
    k, loss = float(p["k"]), float(p["loss"])

    def kinks(y: np.ndarray) -> np.ndarray:
        room, speed = np.transpose(gaps(y.tolist()))
        return np.concatenate([room, 1 - loss * speed, speed[:1]])

    def slope(t: float, y: np.ndarray) -> list[float]:
        del t
        state = y.tolist()
        found = gaps(state)
        acts = [signs[i] < 0 < signs[len(found) + i] for i in range(len(found))]
        both = zip(found, acts, strict=True)
        return rate(state, [-k * room * (1 - loss * v) * on for (room, v), on in both])

    def edge(number: int) -> Callable[[float, np.ndarray], float]:
        def passed(t: float, y: np.ndarray) -> float:
            del t
            return float(kinks(y)[number])

        passed.terminal, passed.direction = True, -signs[number]
        return passed

    # Of a free flight any step is exact, however much it passes.
    settings = {"rtol": RTOL, "atol": ATOL, "dense_output": True, "max_step": ts[-1] / 200}
    signs = np.where(kinks(y) > 0, 1.0, -1.0)
    t, rows = float(ts[0]), [y[None]]
    for _ in range(MOST):
        edges, end = [edge(i) for i in range(len(signs))], float(ts[-1])
        # Both passages of a step that grazes a stop are unseen, until one ends at the depth.
        for _ in range(2):
            found = solve_ivp(slope, (t, end), y, "DOP853", events=edges, **settings)
            fired = np.array([len(x) > 0 for x in found.t_events])
            wrong = (kinks(found.y[:, -1]) * signs < -1e-12) & ~fired
            if not wrong.any():
                break
            end = found.t[-1]
        assert found.success, found.message
        assert not wrong.any(), "a passage was not found"
        at = ts[(ts > t) & (ts <= found.t[-1])]
        rows += [found.sol(at).T] if len(at) else []
        t, y = found.t[-1], found.y[:, -1]
        signs[fired] *= -1
        if found.status == 0:
            return np.concatenate(rows)
    raise RuntimeError("stops begin and end without end")


def law(chance: np.random.Generator) -> dict[str, Any]:
    """Stiffness and dissipation, which there may be none of."""
    loss = chance.choice([0.0, log(chance, 1e-3, 1.0)])
    return {"k": log(chance, 1e2, 1e5), "loss": loss}


# A pendulum between a stop, or two, that its free swing would pass by 1e-4 to 0.3 rad.


def draw_hinge(chance: np.random.Generator) -> Numbers:
    """The angle is that against the hanging bar. Each strike magnifies errors, and more so where a
    stop is just reached: in joint coordinates, which are no kind here, one of 36 motions is wrong
    by 103 tolerances without a word.
    """
    most, length = chance.uniform(0.8, 2.5), log(chance, 0.1, 3.0, 1)
    pull, half = 1.5 * GRAVITY / length[0], length[0] / 2
    other = log(chance, 1e-4, 0.3) - most
    angle = most * chance.uniform(-0.3, 0.3)
    speed = np.sqrt(2 * pull * (np.cos(angle) - np.cos(most))) * chance.choice([-1.0, 1.0])
    c, s = np.sin(angle), -np.cos(angle)  # of the bar
    return numbers(
        **solid(log(chance, 0.1, 10.0, 1), length),
        **law(chance),
        x=[[half * c, half * s, angle - np.pi / 2]],
        v=[[-half * s * speed, half * c * speed, speed]],
        swing=[angle, speed],
        stops=[chance.choice([FAR, other]), most - log(chance, 1e-4, 0.3)],
        end=2 * np.pi / np.sqrt(pull) * log(chance, 0.5, 4.0),
    )


def hinge_scene(p: Numbers) -> rj.Scene:
    links = bars(p)
    hinge = rj.Revolute(ends(links[0], p["lengths"][0])[0], rj.ground.at())
    down, law = rj.ground.at(angle=-np.pi / 2), {"stiffness": p["k"], "dissipation": p["loss"]}
    stop = rj.JointStop(hinge.a, down, *p["stops"], **law)
    return rj.Scene(links, [hinge], [rj.Gravity(), stop])


def between(p: Numbers) -> Gaps:
    """The room before an upper and a lower stop."""
    low, high = p["stops"].tolist()
    return lambda y: [(high - y[0], -y[1]), (y[0] - low, y[1])]


def hinge_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    length = float(p["lengths"][0])
    inertia, pull = float(p["masses"][0]) * length**2 / 3, 1.5 * GRAVITY / length

    def rate(y: Sequence[float], pushes: list[float]) -> list[float]:
        return [y[1], -pull * float(np.sin(y[0])) + (pushes[1] - pushes[0]) / inertia]

    start = p["swing"] + nudge * np.array([1.0, p["swing"][1]])
    found = struck(p, times(p["end"]), start, between(p), rate)
    return length / 2 * np.stack([np.sin(found[:, 0]), -np.cos(found[:, 0])], axis=1)


# A slide in space, up to 1e-4 to 0.3 of its way beyond the upper stop, and back onto the lower.


def draw_slide(chance: np.random.Generator) -> Numbers:
    way, axis = log(chance, 1e-2, 1.0), axes(chance, 1)[0]
    axis *= np.sign(axis[2])
    mass, size, pull = log(chance, 0.1, 10.0), log(chance, 0.1, 1.0), GRAVITY * axis[2]
    rise, offset = way * chance.uniform(0.4, 1.0), size * chance.uniform(-0.5, 0.5, 3)
    foot = chance.uniform(-1.0, 1.0, 3)
    return numbers(
        mass=mass,
        moments=moments(chance, np.array([mass]), np.array([size]))[0],
        **law(chance),
        axis=axis,
        offset=offset,
        foot=foot,
        x=foot - offset,
        speed=np.sqrt(2 * pull * rise),
        stops=[-way * chance.uniform(0.2, 1.0), rise - way * log(chance, 1e-4, 0.3)],
        end=np.sqrt(2 * way / pull) * chance.uniform(1.0, 6.0),
    )


def slide_scene(p: Numbers) -> rj.Scene:
    velocity = p["speed"] * p["axis"]
    body = rj.spatial.RigidBody(
        "block", p["mass"], p["moments"], position=p["x"], velocity=velocity
    )
    slide = rj.Prismatic(
        body.at(p["offset"], axis=p["axis"]), rj.ground.at(p["foot"], axis=p["axis"])
    )
    law = {"stiffness": p["k"], "dissipation": p["loss"], "motion": "travel"}
    stop = rj.JointStop(slide.a, slide.b, *p["stops"], **law)
    return rj.Scene([body], [slide], [rj.Gravity(DOWN), stop])


def slide_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    pull, mass = GRAVITY * float(p["axis"][2]), float(p["mass"])

    def rate(y: Sequence[float], pushes: list[float]) -> list[float]:
        return [y[1], -pull + (pushes[1] - pushes[0]) / mass]

    start = np.array([nudge * np.ptp(p["stops"]), (1 + nudge) * p["speed"]])
    return p["x"] + struck(p, times(p["end"]), start, between(p), rate)[:, :1] * p["axis"]


# A ball on a rope over a pulley at the origin, thrown so that it becomes taut.


def draw_rope(chance: np.random.Generator) -> Numbers:
    """Taut by 1e-4 to 0.3 of its length where the free flight is farthest off, if it comes back."""
    reach, angle = log(chance, 0.1, 3.0), chance.uniform(-np.pi, np.pi)
    x = reach * np.array([np.cos(angle), np.sin(angle)])
    v = np.sqrt(2 * GRAVITY * reach) * chance.uniform(-1.0, 1.0, 2)
    end = np.sqrt(2 * reach / GRAVITY) * chance.uniform(1.5, 6.0)
    t = end * np.linspace(0.0, 1.0, 2001)[:, None]
    off = np.linalg.norm(x + t * v - GRAVITY / 2 * t**2 * np.array([0.0, 1.0]), axis=1)
    peaks = 1 + np.flatnonzero((off[1:-1] > off[:-2]) & (off[1:-1] > off[2:]))
    far = off[peaks[0]] if len(peaks) else off[chance.integers(600, 1400)]
    return numbers(
        mass=log(chance, 0.1, 10.0),
        **law(chance),
        x=x,
        v=v,
        length=max(far * (1 - log(chance, 1e-4, 0.3)), 1.01 * reach),
        wound=chance.uniform(0.1, 1.0),
        end=end,
    )


def rope_scene(p: Numbers) -> rj.Scene:
    body, pulley = ball(p), rj.ground.at()
    winch = rj.ground.at(p["wound"] * np.array([-0.6, -0.8]))
    length = p["length"] + p["wound"]
    rope = rj.Rope(body.at(), winch, length, p["k"], via=[pulley], dissipation=p["loss"])
    return rj.Scene([body], effects=[rj.Gravity(), rope])


def rope_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    mass, length = float(p["mass"]), float(p["length"])

    def gaps(y: Sequence[float]) -> list[tuple[float, float]]:
        off = float(np.hypot(y[0], y[1]))
        return [(length - off, -(y[0] * y[2] + y[1] * y[3]) / off)]

    def rate(y: Sequence[float], pulls: list[float]) -> list[float]:
        pull = pulls[0] / mass / float(np.hypot(y[0], y[1]))
        return [y[2], y[3], -pull * y[0], -pull * y[1] - GRAVITY]

    start = np.concatenate([p["x"] + nudge * length / np.sqrt(2), (1 + nudge) * p["v"]])
    return struck(p, times(p["end"]), start, gaps, rate)[:, :2]


KINDS = {
    "stops of a hinge": Kind(draw_hinge, moved(hinge_scene), hinge_motion),
    "stops of a slide": Kind(draw_slide, moved(slide_scene), slide_motion),
    "stops of a slide, by its joints": Kind(draw_slide, in_joints(slide_scene), slide_motion),
    "rope": Kind(draw_rope, moved(rope_scene), rope_motion),
}
