"""A block on a soft plane: bounces on it, slides on it with friction, sticks and slips.

The truth is the same law of force, written anew, by SciPy's DOP853, whose steps end where contact
begins and ends.
"""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import romjax as rj

from .events import ball, numbers
from .kind import Kind, Numbers, moved, times
from .minimal import ATOL, GRAVITY, RTOL
from .planar import log

MOST = 1000  # times that contact begins or ends


def drawn(
    chance: np.random.Generator, height: float, speed: np.ndarray, end: float, steep: float = 0.6
) -> Numbers:
    """A block that sinks in by 1e-6 to 1e-3 m at rest; the plane is tilted."""
    mass, tilt = log(chance, 0.1, 10.0), chance.uniform(-steep, steep)
    normal = np.array([-np.sin(tilt), np.cos(tilt)])
    sunk = log(chance, 1e-6, 1e-3)
    along = np.array([normal[1], -normal[0]])
    return numbers(
        mass=mass,
        tilt=tilt,
        k=mass * GRAVITY * np.cos(tilt) / sunk**1.5,
        x=(height - sunk) * normal,
        v=speed[0] * along + speed[1] * normal,
        end=end,
    )


def draw_bounces(chance: np.random.Generator) -> Numbers:
    """Dropped from up to a metre."""
    height = log(chance, 1e-2, 1.0)
    end = np.sqrt(2 * height / GRAVITY) * chance.uniform(1.2, 5.0)
    p = drawn(chance, height, np.array([chance.uniform(-1.0, 1.0), 0.0]), end)
    return {**p, "loss": np.asarray(chance.choice([0.0, log(chance, 1e-3, 0.5)]))}


def draw_slide(chance: np.random.Generator) -> Numbers:
    """Pushed to and fro by up to thrice what friction holds."""
    end = log(chance, 0.3, 3.0)
    p = drawn(chance, 0.0, np.array([chance.uniform(-2.0, 2.0), 0.0]), end)
    more = {
        "loss": log(chance, 1e-3, 1.0),
        "rough": chance.uniform(0.05, 0.9),
        "creep": log(chance, 1e-3, 1e-1),
        "frequency": log(chance, 0.3, 10.0) / end,
        "load": p["mass"] * chance.choice([0.0, 1.0]) * chance.uniform(0.0, 20.0),
    }
    return {**p, **numbers(**more)}


def bounces_scene(p: Numbers) -> rj.Scene:
    body = ball(p)
    plane = rj.ground.at((0.0, 0.0), angle=p["tilt"])
    contact = rj.Contact(body.at(), plane, rj.Line(), p["k"], dissipation=p["loss"])
    return rj.Scene([body], effects=[rj.Gravity(), contact])


def slide_scene(p: Numbers) -> rj.Scene:
    body = ball(p)
    plane, friction = rj.ground.at((0.0, 0.0), angle=p["tilt"]), rj.Friction(p["rough"], p["creep"])
    contact = rj.Contact(
        body.at(), plane, rj.Line(), p["k"], dissipation=p["loss"], friction=friction
    )
    push = rj.Force(body.at(), (1.0, 0.0), rj.Sine(p["load"], p["frequency"]))
    return rj.Scene([body], effects=[rj.Gravity(), contact, push])


def rate_of(p: Numbers) -> Callable[[float, np.ndarray], np.ndarray]:
    """Along the plane and out of it."""
    c, s = np.cos(p["tilt"]), np.sin(p["tilt"])
    m, k, loss = (float(p[name]) for name in ("mass", "k", "loss"))
    load, turning = float(p.get("load", 0.0)), 2 * np.pi * float(p.get("frequency", 0.0))
    rough, creep = float(p.get("rough", 0.0)), float(p.get("creep", 1.0))

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        _, gap, along, out = y
        push = load * np.sin(turning * t)
        normal = k * max(-gap, 0.0) ** 1.5 * max(1 - loss * out, 0.0)
        rub = rough * normal * np.tanh(along / creep)
        return np.array(
            [
                along,
                out,
                -GRAVITY * s + (push * c - rub) / m,
                -GRAVITY * c + (normal - push * s) / m,
            ]
        )

    return rate


def motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    c, s = np.cos(p["tilt"]), np.sin(p["tilt"])
    frame, ts = np.array([[c, s], [-s, c]]), times(p["end"])
    y = np.append(frame @ p["x"], frame @ p["v"])
    # Some metres of a fall or a slide are what is moved.
    y[:2] += nudge * max(abs(y[1]), np.linalg.norm(p["v"]) * p["end"])
    t, rows, rate = 0.0, [y[None, :2]], rate_of(p)
    atol = ATOL * np.array([1.0, 1e-2, 1.0, 1.0])
    inside = y[1] < 0
    for _ in range(MOST):

        def edge(t: float, y: np.ndarray) -> float:
            return float(y[1])

        edge.terminal, edge.direction = True, 1.0 if inside else -1.0
        found = solve_ivp(
            rate, (t, ts[-1]), y, "DOP853", rtol=RTOL, atol=atol, events=edge, dense_output=True
        )
        at = ts[(ts > t) & (ts <= found.t[-1])]
        rows += [found.sol(at)[:2].T] if len(at) else []
        t, y, inside = found.t[-1], found.y[:, -1], not inside
        if found.status == 0:
            return np.concatenate(rows) @ frame
    raise RuntimeError("contact begins and ends without end")


KINDS = {
    "bounces on a plane": Kind(draw_bounces, moved(bounces_scene), motion),
    "friction": Kind(draw_slide, moved(slide_scene), motion),
}
