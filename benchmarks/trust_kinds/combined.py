"""Where two features meet: controllers with states on what bends, drives that begin late, of rigid
and of flexible mechanisms, and ropes in loops.

Without a freedom left the truth is geometry; else it is the motion in minimal coordinates by
SciPy's DOP853 (`minimal.py`).
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from . import flexible
from .driven import Given
from .flexible import ROOTS, beam, beam_energy, bending, frequencies, hung
from .joints import in_joints
from .kind import Kind, Numbers, moved
from .minimal import Minimal, weight
from .planar import bars, draw_four_bar, four_bar_joints, four_bar_places, grashof, log, solid
from .states import Beside

# Of the free-free modes: the slope at an end over the deflection there, of a length of one.
SLOPES = ROOTS * np.array([0.982502214576238, 1.000777311907269])


# A PID without and with a lag turns the lower end of a beam. s = (φ, q₁, q₂).


def slope(p: Numbers) -> Any:
    """Of the lower end by φ and the amplitudes."""
    return jnp.append(1.0, -2 * SLOPES / (jnp.sqrt(p["mass"]) * p["length"]))


def servo(p: Numbers, t: Any, s: Any, rate: Any, z: Any) -> tuple[Any, Any]:
    error = p["target"] - slope(p) @ s
    command = p["P"] * error + z[0] - p["D"] * slope(p) @ rate
    damped = flexible.modal_damping(p, t, s, rate)
    rates = jnp.stack([p["I"] * error, (command - z[1]) / p["lag"]])
    return z[1] * slope(p) + damped, rates


SERVO = Beside(
    lambda p, t, s: hung(p, s, flexible.ZERO)[None],
    2,
    servo,
    lambda p, x, rate: beam_energy(p, x[0], rate[0]),
    lambda p, t, s, x: bending(p, x[0]),
)


def draw_servo(chance: np.random.Generator) -> Numbers:
    """Gains by a frequency below that of the beam."""
    p = flexible.draw_beam(chance)
    s = np.append(chance.uniform(-3.0, 0.0), p["bent"])
    ds = np.append(chance.uniform(-3.0, 3.0), flexible.ZERO)
    omega = float(frequencies(p)[0]) * log(chance, 0.02, 0.2)
    stiff = p["mass"] * p["length"] ** 2 / 3 * omega**2
    more = {
        "P": stiff,
        "I": stiff * omega * chance.uniform(0.0, 0.3),
        "D": 1.4 * stiff / omega,
        "lag": log(chance, 0.01, 0.3) / omega,
        "target": s[0] + chance.uniform(-1.0, 1.0),
        "end": log(chance, 0.2, 1.5),
        "s": s,
        "ds": ds,
    }
    return SERVO.start({**p, **{name: np.asarray(x) for name, x in more.items()}})


def servo_scene(p: Numbers) -> rj.Scene:
    body = beam(p, 0)
    ends = body.at("start"), rj.ground.at()
    target = rj.Constant(p["target"])
    control = rj.PID(*ends, target, p["P"], p["I"], p["D"], lag=p["lag"])
    return rj.Scene([body], [rj.Revolute(*ends)], [rj.Gravity(), control])


# A way or an angle that begins late, as `Step`.


def draw_step(chance: np.random.Generator, end: float, height: float) -> Numbers:
    """From a tenth to nine tenths of the run on, in a hundredth of it to half of it."""
    return {
        "height": np.asarray(height),
        "onset": np.asarray(end * chance.uniform(0.1, 0.9)),
        "duration": np.asarray(end * log(chance, 0.01, 0.5)),
    }


def late(p: Numbers, t: Any) -> Any:
    x = jnp.clip((t - p["onset"]) / p["duration"], 0.0, 1.0)
    return p["height"] * x**3 * (10 - 15 * x + 6 * x**2)


def late_signal(p: Numbers) -> rj.Step:
    return rj.Step(p["height"], p["onset"], p["duration"])


def corners(p: Numbers) -> Any:
    return np.array([p["onset"], p["onset"] + p["duration"]])


def carried(p: Numbers, t: Any, s: Any) -> Any:
    """The cart, and the beam that hangs from it."""
    way = late(p, t)
    cart = jnp.zeros(5).at[0].set(way)
    return jnp.stack([cart, hung(p, s, cart[:2])])


BASE = Minimal(
    carried,
    lambda p, x, rate: beam_energy(p, x[1], rate[1]),
    lambda p, t, s, x: bending(p, x[1]),
    flexible.modal_damping,
    breaks=corners,
)


def draw_base(chance: np.random.Generator) -> Numbers:
    p = flexible.draw_beam(chance)
    end = log(chance, 0.2, 1.5)
    s = np.append(chance.uniform(-3.0, 0.0), p["bent"])
    ds = np.append(chance.uniform(-3.0, 3.0), flexible.ZERO)
    step = draw_step(chance, end, chance.uniform(-2.0, 2.0))
    return BASE.start({**p, **step, "s": s, "ds": ds, "end": np.asarray(end)})


def base_scene(p: Numbers) -> rj.Scene:
    cart, body = rj.RigidBody("cart", 1.0, 1.0), beam(p, 1)
    joints = [
        rj.Prismatic(cart.at(), rj.ground.at()),
        rj.PrescribedTravel(cart.at(), rj.ground.at(), late_signal(p)),
        rj.Revolute(body.at("start"), cart.at()),
    ]
    return rj.Scene([cart, body], joints, [rj.Gravity()])


# A four-bar whose crank stands, and is turned later by up to a turn.


LATE = Given(four_bar_places, lambda p, t: p["from"] + late(p, t))


def draw_late(chance: np.random.Generator) -> Numbers:
    lengths, end = grashof(chance), log(chance, 0.2, 10.0)
    p = solid(log(chance, 0.1, 10.0, 3), lengths[:3]) | {"lengths": lengths}
    p |= {"end": np.asarray(end), "from": np.asarray(chance.uniform(-3.0, 3.0))}
    return LATE.start({**p, **draw_step(chance, end, chance.uniform(-6.0, 6.0))})


def late_scene(p: Numbers) -> rj.Scene:
    links = bars(p)
    signal = rj.Sum((rj.Constant(p["from"]), late_signal(p)))
    motor = rj.PrescribedAngle(links[0].at(), rj.ground.at(), signal)
    return rj.Scene(links, [*four_bar_joints(p, links), motor], [rj.Gravity()])


# A rope from the middle of the coupler of a four-bar.


def rope_length(p: Numbers, x: Any) -> Any:
    return jnp.linalg.norm(x[1, :2] - p["hook"])


def rope_energy(p: Numbers, t: Any, s: Any, x: Any) -> Any:
    taut = jnp.maximum(rope_length(p, x) - p["rope"], 0.0)
    return weight(p, t, s, x) + 0.5 * p["k"] * taut**2


ROPE = Minimal(four_bar_places, potential=rope_energy)


def draw_rope(chance: np.random.Generator) -> Numbers:
    """Slack at the start, and taut at some other angle of the crank."""
    p = draw_four_bar(chance)
    p["hook"] = chance.uniform(-2.0, 2.0, 2)
    turn = np.linspace(0.0, 2 * np.pi, 60)
    found = [float(rope_length(p, four_bar_places(p, 0.0, s[None]))) for s in turn]
    now = float(rope_length(p, four_bar_places(p, 0.0, p["s"])))
    p["rope"] = np.asarray(now + chance.uniform(0.02, 0.6) * max(max(found) - now, 0.1))
    hertz = log(chance, 3.0, 100.0) / min(p["end"], 1.0)
    p["k"] = np.asarray(np.sum(p["masses"]) * (2 * np.pi * hertz) ** 2)
    return p


def rope_scene(p: Numbers) -> rj.Scene:
    links = bars(p)
    rope = rj.Rope(links[1].at(), rj.ground.at(p["hook"]), p["rope"], p["k"])
    return rj.Scene(links, four_bar_joints(p, links), [rj.Gravity(), rope])


KINDS = {
    "PID on a beam": Kind(draw_servo, moved(servo_scene), SERVO.motion),
    "beam on a late base": Kind(draw_base, moved(base_scene), BASE.motion),
    "late four-bar": Kind(draw_late, moved(late_scene), LATE.motion),
    "rope in a four-bar": Kind(draw_rope, moved(rope_scene), ROPE.motion),
    "PID on a beam, by its joints": Kind(draw_servo, in_joints(servo_scene), SERVO.motion),
    "beam on a late base, by its joints": Kind(draw_base, in_joints(base_scene), BASE.motion),
    "rope in a four-bar, by its joints": Kind(draw_rope, in_joints(rope_scene), ROPE.motion),
}
