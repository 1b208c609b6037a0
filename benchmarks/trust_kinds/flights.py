"""Free flights of bodies that tumble, contacts and impacts of their tips: the truth of `tumbling`.

Flights are closed forms, as all bodies have two equal moments of inertia. They are sampled at every
fiftieth of a radian or finer, and followed to where the room before a tip turns. While a force
acts, the same laws are integrated by SciPy's DOP853.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from .kind import Numbers, times
from .minimal import RTOL

FINE = 0.02  # rad between samples of a flight
MOST = 200  # flights
Z = np.array([0.0, 0.0, 1.0])


class State(NamedTuple):
    """A body in flight (n times): place, orientation, velocity and spin by the world's axes."""

    x: np.ndarray
    turn: Rotation
    v: np.ndarray
    spin: np.ndarray


def start(p: Numbers, nudge: float) -> State:
    x = p["x"] + nudge * np.linalg.norm(p["tip"]) / np.sqrt(2)
    turn = Rotation.from_quat(p["turn"], scalar_first=True)
    return State(x, turn, (1 + nudge) * p["v"], (1 + nudge) * p["spin"])


def fly(p: Numbers, s: State, t: Sequence[float] | np.ndarray) -> State:
    """After free flights of the times (n,)."""
    t = np.asarray(t, float)[:, None]
    level, axial = p["moments"][[0, 2]]
    own = s.turn.inv().apply(s.spin)
    total = s.turn.apply(p["moments"] * own) / level
    back = own[2] * (1 - axial / level) * Z
    turn = Rotation.from_rotvec(t * total) * s.turn * Rotation.from_rotvec(t * back)
    fall = np.array([0.0, -p["down"], 0.0])
    own = Rotation.from_rotvec(-t * back).apply(own)
    return State(s.x + t * s.v + t**2 / 2 * fall, turn, s.v + t * fall, turn.apply(own))


class Law(NamedTuple):
    """`room` (n,) of points (n, 3) and the way out of it; and the push by depth."""

    room: Callable[[Numbers, np.ndarray], tuple[np.ndarray, np.ndarray]]
    power: float = 1.5


def floor_room(p: Numbers, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    del p
    return tip[:, 1], np.broadcast_to([0.0, 1.0, 0.0], tip.shape)


def rope_room(p: Numbers, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rope is of the length at which the floor would be, right above the start."""
    way = tip - 2 * p["x"]
    off = np.linalg.norm(way, axis=1)
    return 2 * p["x"][1] - off, -way / off[:, None]


def seen(p: Numbers, law: Law, s: State) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The room before the tip, its rate, the way out, and the tip's arm, of many states."""
    arm = s.turn.apply(p["tip"])
    room, way = law.room(p, np.atleast_2d(s.x + arm))
    rate = np.sum(way * np.atleast_2d(s.v + np.cross(s.spin, arm)), axis=1)
    return room, rate, way, np.atleast_2d(arm)


def passages(p: Numbers, law: Law, s: State, end: float) -> Iterator[float]:
    """The times of a flight at which the room is zero."""

    def look(which: int) -> Callable[[float], float]:
        return lambda t: float(seen(p, law, fly(p, s, [t]))[which][0])

    # No body here turns faster than thrice its spin.
    ts = np.linspace(0.0, end, int(3 * np.linalg.norm(s.spin) * end / FINE) + 100)
    room, rate, *_ = seen(p, law, fly(p, s, ts))
    touches = abs(room[0]) < 1e-12 * np.linalg.norm(p["x"])
    sign = np.sign(np.append(rate[0] if touches else room[0], room[1:]))
    turns = (sign[1:] == sign[:-1]) & (sign[1:] * rate[:-1] < 0) & (sign[1:] * rate[1:] > 0)
    for i in np.flatnonzero(turns | (sign[1:] != sign[:-1])):
        # One that touches at the start is where it goes to after a thousandth of the first part.
        edges = [ts[i] + 1e-3 * ts[1] * (touches and i == 0), ts[i + 1]]
        if turns[i]:
            edges.insert(1, brentq(look(1), *edges, xtol=1e-16, rtol=1e-14))
        ends = [look(0)(t) for t in edges]
        for j in range(len(edges) - 1):
            if ends[j] * ends[j + 1] < 0:
                yield brentq(look(0), edges[j], edges[j + 1], xtol=1e-16, rtol=1e-14)


def pushed(p: Numbers, law: Law, s: State, end: float) -> Any:
    """The motion (x, rotation matrix, v, spin) while the law acts, by DOP853."""
    moments = p["moments"]

    def apart(y: np.ndarray) -> State:
        return State(y[:3], Rotation.from_matrix(y[3:12].reshape(3, 3)), y[12:15], y[15:])

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        del t
        frame, spin = y[3:12].reshape(3, 3), y[15:]
        arm = frame @ p["tip"]
        room, way = law.room(p, (y[:3] + arm)[None])
        rate = way[0] @ (y[12:15] + np.cross(spin, arm))
        force = p["k"] * max(-room[0], 0.0) ** law.power * max(1 - p["loss"] * rate, 0.0) * way[0]
        tensor = frame * moments @ frame.T
        torque = np.cross(arm, force) - np.cross(spin, tensor @ spin)
        turning = np.cross(spin, frame.T).T.ravel()
        a = force / p["mass"] - np.array([0.0, p["down"], 0.0])
        return np.concatenate([y[12:15], turning, a, np.linalg.solve(tensor, torque)])

    def leaves(t: float, y: np.ndarray) -> float:
        del t
        tip = y[:3] + y[3:12].reshape(3, 3) @ p["tip"]
        return float(law.room(p, tip[None])[0][0])

    leaves.terminal, leaves.direction = True, 1.0
    y0 = np.concatenate([s.x, s.turn.as_matrix().ravel(), s.v, s.spin])
    arm, fast = np.linalg.norm(p["tip"]), np.linalg.norm(s.spin)
    atol = 1e-14 * np.concatenate(
        [np.full(3, arm), np.ones(9), np.full(3, arm * fast), np.full(3, fast)]
    )
    settings = {"rtol": RTOL, "atol": atol, "dense_output": True, "max_step": 0.1 / fast}
    found = solve_ivp(
        slope, (0.0, end), y0, "DOP853", events=leaves, first_step=min(1e-4 / fast, end), **settings
    )
    return found, apart(found.y[:, -1])


def struck(p: Numbers, law: Law, s: State) -> State:
    """After an impact of the tip."""
    _, rate, way, arm = (x[0] for x in seen(p, law, s))
    frame = s.turn.as_matrix()
    turning = np.linalg.solve(frame * p["moments"] @ frame.T, np.cross(arm, way))
    impulse = -(1 + p["bounce"]) * rate / (1 / p["mass"] + way @ np.cross(turning, arm))
    return s._replace(v=s.v + impulse / p["mass"] * way, spin=s.spin + impulse * turning)


def motion(law: Law, rigid: bool = False) -> Callable[..., np.ndarray]:
    """Places at the output times, of soft contacts or of impacts."""

    def of(p: Numbers, nudge: float = 0.0) -> np.ndarray:
        ts, s, t = times(p["end"]), start(p, nudge), 0.0
        rows = np.zeros((len(ts), 3))
        for _ in range(MOST):
            left = ts[-1] - t
            first = next(passages(p, law, s, left), left)
            rows[ts >= t] = fly(p, s, ts[ts >= t] - t).x
            if first == left:
                return rows
            s, t = State(*(x[0] for x in fly(p, s, [first]))), t + first
            if rigid:
                s = struck(p, law, s)
                continue
            found, s = pushed(p, law, s, ts[-1] - t)
            here = (ts >= t) & (ts <= t + found.t[-1])
            rows[here] = found.sol(ts[here] - t)[:3].T if here.any() else 0.0
            t += found.t[-1]
            if found.status == 0:
                return rows
        raise RuntimeError("contact begins and ends without end")

    return of


FLOOR, ROPE = Law(floor_room), Law(rope_room, 1.0)
