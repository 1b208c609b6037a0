"""Controllers and actuators with states of their own: on the crank of a four-bar whose last pin is
made twice, in a crane, and with a clock.

The truth is the motion in minimal coordinates with the states beside them, by SciPy's DOP853
(`minimal.py`); of what has a clock, from tick to tick.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import Minimal, integrated, planar_energy, weight
from .planar import (
    along,
    bars,
    draw_four_bar,
    ends,
    four_bar_places,
    four_bar_scene,
    log,
    solid,
)


class Beside(Minimal):
    """With `states` (p, t, s, ṡ, z) → (forces on the first coordinates, rates of z): each state is
    the rate of a coordinate that nothing depends on, the last of s. `kinetic` and `potential` are
    those of the mechanism, as in `Minimal`.
    """

    def __init__(
        self,
        places: Callable[..., Any],
        count: int,
        states: Callable[..., Any],
        kinetic: Callable[..., Any] = planar_energy,
        potential: Callable[..., Any] = weight,
    ):
        def split(x: Any) -> tuple[Any, Any]:
            return x[:-count], x[-count:]

        def rows(p: Numbers, t: Any, s: Any) -> Any:
            own, others = split(s)
            x = places(p, t, own)
            beside = jnp.zeros((count, x.shape[1])).at[:, 2].set(others)
            return jnp.concatenate([x, beside])

        def energy(p: Numbers, x: Any, rate: Any) -> Any:
            own, others = split(rate)
            return kinetic(p, split(x)[0], own) + 0.5 * jnp.sum(others[:, 2] ** 2)

        def force(p: Numbers, t: Any, s: Any, rate: Any) -> Any:
            return jnp.concatenate(states(p, t, split(s)[0], *split(rate)))

        super().__init__(rows, energy, lambda p, t, s, x: potential(p, t, s, split(x)[0]), force)
        self._count = count

    def start(self, p: Numbers) -> Numbers:
        """With "s" and "ds" of the mechanism alone, and the states "z" where they are not zero."""
        z = p.get("z", np.zeros(self._count))
        both = {"s": np.append(p["s"], np.zeros(self._count)), "ds": np.append(p["ds"], z)}
        own = super().start({**p, **both})
        return {**own, "x": own["x"][: -self._count], "v": own["v"][: -self._count]}

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        return super().motion(p, nudge)[:, : -2 * self._count]


# A PID that lags, on a crank.


def wanted(p: Numbers, t: Any) -> Any:
    return p["swing"] * jnp.sin(2 * jnp.pi * p["frequency"] * t) + p["target"]


def wanted_rate(p: Numbers, t: Any) -> Any:
    turning = 2 * jnp.pi * p["frequency"]
    return p["swing"] * turning * jnp.cos(turning * t)


def pid(p: Numbers, t: Any, s: Any, rate: Any, z: Any) -> tuple[Any, Any]:
    error, slope = wanted(p, t) - s[0], wanted_rate(p, t) - rate[0]
    command = p["P"] * error + z[0] + p["D"] * slope
    cut = jnp.clip(command, -p["most"], p["most"])
    integral = p["I"] * error + (cut - command) / p["tracking"]
    return z[1:], jnp.stack([integral, (cut - z[1]) / p["lag"]])


PID = Beside(four_bar_places, 2, pid)


def draw_pid(chance: np.random.Generator) -> Numbers:
    """Gains by a frequency of some hertz, often with a command that is cut off."""
    p = draw_four_bar(chance)
    inertia = p["masses"][:3].sum() * p["lengths"][0] ** 2
    omega = 2 * np.pi * log(chance, 0.3, 5.0)
    stiff = inertia * omega**2
    found = {
        "P": stiff,
        "I": stiff * omega * chance.uniform(0.0, 0.3),
        "D": 1.4 * stiff / omega,
        "most": stiff * log(chance, 0.1, 10.0),
        "tracking": log(chance, 0.3, 3.0) / omega,
        "lag": log(chance, 0.01, 0.5) / omega,
        "target": p["s"][0] + chance.uniform(-1.0, 1.0),
        "swing": chance.choice([0.0, 1.0]) * chance.uniform(0.1, 2.0),
        "frequency": log(chance, 0.3, 5.0) / p["end"],
    }
    return PID.start({**p, **{name: np.asarray(x) for name, x in found.items()}})


def pid_scene(p: Numbers) -> rj.Scene:
    scene = four_bar_scene(p, twice=True)
    target = rj.Sum((rj.Sine(p["swing"], p["frequency"]), rj.Constant(p["target"])))
    control = rj.PID(
        scene.bodies[0].at(),
        rj.ground.at(),
        target,
        p["P"],
        p["I"],
        p["D"],
        least=-p["most"],
        largest=p["most"],
        tracking=p["tracking"],
        lag=p["lag"],
    )
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, control])


# A crane: a boom that a cylinder lifts.


def boom_places(p: Numbers, t: Any, s: Any) -> Any:
    del t
    return jnp.append(along(p["lengths"][0] / 2, s[0]), s[0])[None]


def reach(p: Numbers, angle: Any) -> Any:
    """The distance of the eyes, and its slope by the angle."""
    foot, (c, s) = p["foot"], along(1.0, angle)
    at, across = p["eye"] * jnp.stack([c, s]), p["eye"] * jnp.stack([-s, c])
    size = jnp.linalg.norm(at - foot)
    return size, (at - foot) @ across / size


def root(p: Numbers, difference: Any) -> Any:
    return difference / (difference**2 + p["transition"] ** 2) ** 0.25


def cylinder(p: Numbers, t: Any, s: Any, rate: Any, z: Any) -> tuple[Any, Any]:
    size, slope = reach(p, s[0])
    out, speed = size - p["retracted"], slope * rate[0]
    valve = p["valve"] * jnp.sin(2 * jnp.pi * p["frequency"] * t)
    area, rod = p["areas"]
    given = jnp.where(valve > 0, root(p, p["supply"] - z[0]), root(p, z[0] - p["tank"]))
    back = jnp.where(valve > 0, root(p, p["tank"] - z[1]), root(p, z[1] - p["supply"]))
    leak = p["leakage"] * (z[0] - z[1])
    flow_a = p["flow"] * valve * given - area * speed - leak
    flow_b = p["flow"] * valve * back + rod * speed + leak
    rates = jnp.stack(
        [flow_a / (p["dead"] + area * out), flow_b / (p["dead"] + rod * (p["stroke"] - out))]
    )
    push = z[0] * area - z[1] * rod - p["damping"] * speed
    return push[None] * slope, p["bulk"] * rates


CYLINDER = Beside(boom_places, 2, cylinder)


def draw_crane(chance: np.random.Generator) -> Numbers:
    """Of tonnes or of grams, whose pressures begin in balance."""
    length, mass = log(chance, 0.1, 10.0), log(chance, 0.1, 1e4)
    angle, eye = chance.uniform(0.0, 0.8), 0.5 * length
    foot = length * np.array([0.3, -0.3])
    p = solid(np.array([mass]), np.array([length])) | {"foot": foot, "eye": eye}
    size, slope = (float(x) for x in reach(p, angle))
    push = 9.81 * mass * length / 2 * np.cos(angle) / slope
    supply, stroke = log(chance, 1e6, 3e7), length
    area = push / supply * chance.uniform(2.5, 5.0)
    rod = area * chance.uniform(0.4, 0.8)
    pressures = np.array([push / area + 2e5 * rod / area, 2e5])
    volume = area * stroke
    found = {
        "areas": np.array([area, rod]),
        "retracted": size - chance.uniform(0.3, 0.6) * stroke,
        "stroke": stroke,
        "supply": supply,
        "tank": 1e5,
        "transition": 1e4,
        "bulk": log(chance, 2e8, 1.6e9),
        "dead": 0.1 * volume,
        "flow": 0.2 * volume / np.sqrt(supply),
        "leakage": chance.choice([0.0, 1e-3]) * volume / supply,
        "damping": chance.choice([0.0, 0.1]) * mass,
        "valve": chance.uniform(-1.0, 1.0),
        "frequency": log(chance, 0.3, 3.0),
        "end": log(chance, 0.1, 1.0),
        "s": np.array([angle]),
        "ds": chance.uniform(-0.1, 0.1, 1),
        "z": pressures,
    }
    return CYLINDER.start({**p, **{name: np.asarray(x) for name, x in found.items()}})


def crane_scene(p: Numbers) -> rj.Scene:
    (boom,) = bars(p)
    xp = np if isinstance(p["eye"], np.ndarray) else jnp
    arm = xp.stack([p["eye"] - p["lengths"][0] / 2, 0.0 * p["eye"]])
    lift = rj.HydraulicCylinder(
        boom.at(arm),
        rj.ground.at(p["foot"]),
        rj.Sine(p["valve"], p["frequency"]),
        p["areas"][0],
        p["areas"][1],
        p["retracted"],
        p["stroke"],
        p["supply"],
        p["flow"],
        p["dead"],
        tank=p["tank"],
        bulk=p["bulk"],
        leakage=p["leakage"],
        damping=p["damping"],
        transition=p["transition"],
        pressure_a=p["z"][0],
        pressure_b=p["z"][1],
    )
    hinge = rj.Revolute(ends(boom, p["lengths"][0])[0], rj.ground.at())
    return rj.Scene([boom], [hinge], [rj.Gravity(), lift])


# A controller with a clock, with a memory of the last error, on a crank.


def law(t: Any, state: Any, measured: Any) -> tuple[Any, Any]:
    """(P, D, target) are the last of what it remembers."""
    gain, rate, target = state[1:]
    error = target - measured[0]
    command = gain * error + rate * (error - state[0]) - 0.1 * rate * measured[1]
    return command, jnp.stack([error, gain, rate, target])


class Ticking(Minimal):
    """From tick to tick, the torque on the first coordinate held in between."""

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        own = {name: value for name, value in p.items() if name not in ("x", "v")}
        ts, d = times(own["end"]), len(own["s"])
        y = np.concatenate([own["s"], own["ds"]]).astype(float)
        y[:d] += nudge
        memory = np.asarray(own["memory"])
        ticks = np.arange(0.0, float(own["end"]), float(own["period"]))
        rows = [y[None]]
        for begin, end in zip(ticks, [*ticks[1:], float(own["end"])], strict=True):
            torque, memory = law(begin, memory, y[[0, d]])
            held = {**own, "torque": np.asarray(torque)}
            inner = ts[(ts > begin + 1e-12) & (ts <= end + 1e-12)]
            at = np.unique([begin, *np.minimum(inner, end), end])
            found = integrated(self._rate(held), at, y)
            y = found[-1]
            rows.append(found[1 : 1 + len(inner)])
        whole = np.concatenate(rows)
        return np.asarray(self._seen(own, ts, whole[:, :d])).reshape(len(ts), -1)


CLOCK = Ticking(
    four_bar_places,
    force=lambda p, t, s, rate: jnp.reshape(p["torque"], (1,)) + 0.0 * s,
)


def draw_clock(chance: np.random.Generator) -> Numbers:
    p = draw_four_bar(chance)
    stiff = p["masses"][:3].sum() * p["lengths"][0] ** 2 * (2 * np.pi * log(chance, 0.1, 1.0)) ** 2
    memory = [0.0, stiff, chance.uniform(0.0, 2.0) * stiff, p["s"][0] + chance.uniform(-1.0, 1.0)]
    period = p["end"] / log(chance, 3.0, 60.0)
    own = {"memory": np.array(memory), "period": np.asarray(period), "torque": np.asarray(0.0)}
    return CLOCK.start({**p, **own})


def clock_scene(p: Numbers) -> rj.Scene:
    scene = four_bar_scene(p, twice=True)
    clock = rj.Sampled(p["period"], law, ["bar0.phi", "bar0.phi'"], ["torque"], p["memory"])
    motor = rj.Torque(scene.bodies[0].at(), rj.Held("torque"))
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, clock, motor])


KINDS = {
    "PID": Kind(draw_pid, moved(pid_scene), PID.motion),
    "crane": Kind(draw_crane, moved(crane_scene), CYLINDER.motion),
    "clock": Kind(draw_clock, moved(clock_scene), CLOCK.motion),
}
