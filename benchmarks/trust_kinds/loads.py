"""A cart with a pendulum, at rest until a load comes: pulses, steps, vibrations, tables.

The truth is the motion in minimal coordinates by SciPy's DOP853 (`minimal.py`), whose steps end at
the corners of the load.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved
from .minimal import Minimal
from .planar import along, bars, ends, log, solid

POINTS = 40  # of a table


def cart_places(p: Numbers, t: Any, s: Any) -> Any:
    """Of cart and pendulum; s = (x, φ)."""
    del t
    hung = jnp.stack([s[0], 0.0 * s[0]]) + along(p["lengths"][1], s[1]) / 2
    return jnp.stack([jnp.append(s[:1], jnp.zeros(2)), jnp.append(hung, s[1])])


def force(p: Numbers, t: Any, s: Any, rate: Any, load: Callable[..., Any]) -> Any:
    pull = load(p, t) - p["stiffness"] * s[0] - p["damping"] * rate[0]
    return jnp.stack([pull, 0.0 * pull])


def cart(load: Callable[..., Any], breaks: Callable[..., Any] = lambda p: ()) -> Minimal:
    """The truth under the force `load` (p, t) on the cart."""
    return Minimal(
        cart_places, force=lambda p, t, s, rate: force(p, t, s, rate, load), breaks=breaks
    )


def draw_cart(chance: np.random.Generator) -> Numbers:
    """Hanging at rest, on a spring of a period of some tenths of the run, or some runs."""
    end, masses = log(chance, 0.3, 3.0), log(chance, 0.1, 10.0, 2)
    numbers = solid(masses, log(chance, 0.2, 2.0, 2))
    stiffness = np.sum(masses) * (log(chance, 1.0, 60.0) / end) ** 2
    damping = chance.choice([0.0, 0.05]) * np.sqrt(stiffness * masses[0])
    start = {"s": np.array([0.0, -np.pi / 2]), "ds": np.zeros(2)}
    lone = {"stiffness": stiffness, "damping": damping, "end": end, "mass": np.sum(masses)}
    return {**numbers, **start, **{name: np.asarray(x) for name, x in lone.items()}}


def scene_of(signal: Callable[[Numbers], rj.AbstractSignal]) -> Callable[[Numbers], rj.Scene]:
    def scene(p: Numbers) -> rj.Scene:
        body, bar = bars(p)
        joints = [
            rj.Prismatic(body.at(), rj.ground.at()),
            rj.Revolute(ends(bar, p["lengths"][1])[0], body.at()),
        ]
        effects = [
            rj.Gravity(),
            rj.Spring(body.at(), rj.ground.at(), p["stiffness"]),
            rj.Damper(body.at(), rj.ground.at(), p["damping"]),
            rj.Force(body.at(), (1.0, 0.0), signal(p)),
        ]
        return rj.Scene([body, bar], joints, effects)

    return scene


# A pulse that gives the cart up to a speed of a metre in a second, and lasts from 1e-4 to 1e-1 of
# the run, as a table.


def draw_pulse(chance: np.random.Generator) -> Numbers:
    p = draw_cart(chance)
    width = log(chance, 1e-4, 1e-1) * p["end"]
    begin = chance.uniform(0.0, 0.9) * p["end"]
    peak = 2 * p["mass"] * chance.uniform(-1.0, 1.0) / width
    share = chance.uniform(0.1, 0.9)
    at = begin + width * np.array([0.0, share, 1.0])
    return PULSE.start({**p, "at": at, "load": np.array([0.0, peak, 0.0])})


def table_load(p: Numbers, t: Any) -> Any:
    return jnp.interp(t, p["at"], p["load"])


PULSE = cart(table_load, lambda p: p["at"])


def draw_table(chance: np.random.Generator) -> Numbers:
    """Many points, some of them close to each other."""
    p = draw_cart(chance)
    gaps = log(chance, 1e-3, 1.0, POINTS)
    at = np.cumsum(gaps) / np.sum(gaps) * p["end"]
    load = p["mass"] * log(chance, 0.01, 100.0) * chance.uniform(-1.0, 1.0, POINTS)
    return TABLE.start({**p, "at": at, "load": load})


TABLE = cart(table_load, lambda p: p["at"])


def table(p: Numbers) -> rj.AbstractSignal:
    return rj.Table(p["at"], p["load"])


# On and off again, smoothly, within 1e-4 to 1e-1 of the run.


def step_load(p: Numbers, t: Any) -> Any:
    total = 0.0 * t
    for begin, sign in ((p["begin"], 1.0), (p["leave"], -1.0)):
        x = jnp.clip((t - begin) / p["rise"], 0.0, 1.0)
        total += sign * p["load"] * x**3 * (10 - 15 * x + 6 * x**2)
    return total


def draw_step(chance: np.random.Generator) -> Numbers:
    p = draw_cart(chance)
    rise, lasts = log(chance, 1e-4, 1e-1, 2) * p["end"]
    begin = chance.uniform(0.0, 0.8) * p["end"]
    load = p["mass"] * chance.uniform(-1.0, 1.0) / (rise + lasts)
    times_ = {"begin": begin, "leave": begin + rise + lasts, "rise": rise, "load": load}
    return STEP.start({**p, **{name: np.asarray(x) for name, x in times_.items()}})


STEP = cart(
    step_load,
    lambda p: [p[name] + more * p["rise"] for name in ("begin", "leave") for more in (0.0, 1.0)],
)


def step(p: Numbers) -> rj.AbstractSignal:
    on = rj.Step(p["load"], p["begin"], p["rise"])
    return rj.Sum((on, rj.Step(-p["load"], p["leave"], p["rise"])))


# A vibration of up to 300 cycles in a run, and another whose frequency changes.


def sine_load(p: Numbers, t: Any) -> Any:
    cycles = p["frequency"] * t
    chirp = (p["frequency"] + p["growth"] * t / 2) * t
    both = jnp.sin(2 * jnp.pi * cycles + p["phase"]), jnp.sin(2 * jnp.pi * chirp)
    return p["load"][0] * both[0] + p["load"][1] * both[1]


def draw_sine(chance: np.random.Generator) -> Numbers:
    p = draw_cart(chance)
    frequency = log(chance, 0.5, 300.0) / p["end"]
    numbers = {
        "frequency": frequency,
        "growth": frequency * chance.uniform(-1.0, 1.0) / p["end"],
        "phase": chance.uniform(-3.0, 3.0),
        "load": p["mass"] * log(chance, 0.01, 10.0) * frequency * chance.uniform(-1.0, 1.0, 2),
    }
    return SINE.start({**p, **{name: np.asarray(x) for name, x in numbers.items()}})


SINE = cart(sine_load)


def sine(p: Numbers) -> rj.AbstractSignal:
    even = rj.Sine(p["load"][0], p["frequency"], p["phase"])
    return rj.Sum((even, rj.Chirp(p["load"][1], p["frequency"], p["growth"])))


# A signal of one's own that says nothing of when something happens.


class Bell(rj.AbstractSignal):
    """A bell of some height around a time."""

    height: Any
    middle: Any
    width: Any

    def __call__(self, t: Any) -> Any:
        return self.height * jnp.exp(-(((t - self.middle) / self.width) ** 2))


def bell_load(p: Numbers, t: Any) -> Any:
    return p["load"] * jnp.exp(-(((t - p["begin"]) / p["rise"]) ** 2))


def draw_bell(chance: np.random.Generator) -> Numbers:
    p = draw_cart(chance)
    width = log(chance, 1e-4, 1e-1) * p["end"]
    begin, load = chance.uniform(0.0, 0.9) * p["end"], p["mass"] * chance.uniform(-1.0, 1.0) / width
    bell = {"begin": begin, "rise": width, "load": load}
    return BELL.start({**p, **{name: np.asarray(x) for name, x in bell.items()}})


BELL = cart(bell_load, lambda p: p["begin"] + p["rise"] * np.linspace(-6.0, 6.0, 13))


def bell(p: Numbers) -> rj.AbstractSignal:
    return Bell(jnp.asarray(p["load"]), jnp.asarray(p["begin"]), jnp.asarray(p["rise"]))


KINDS = {
    "pulse": Kind(draw_pulse, moved(scene_of(table)), PULSE.motion),
    "table": Kind(draw_table, moved(scene_of(table)), TABLE.motion),
    "step": Kind(draw_step, moved(scene_of(step)), STEP.motion),
    "vibration": Kind(draw_sine, moved(scene_of(sine)), SINE.motion),
    "own signal": Kind(draw_bell, moved(scene_of(bell)), BELL.motion),
}
