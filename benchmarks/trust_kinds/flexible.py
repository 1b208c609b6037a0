"""Planar mechanisms with a beam that bends: a pendulum, and the rod of a slider-crank.

The truth is the motion in minimal coordinates, the freedoms of the mechanism and the amplitudes of
the free-free modes, by SciPy's DOP853 (`minimal.py`). The energies of a beam are written anew.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, moved
from .minimal import GRAVITY, Minimal
from .planar import along, log

ROOTS = np.array([4.730040744862704, 7.853204624095838])  # cos x cosh x = 1
ZERO = np.zeros(2)


def draw_beam(chance: np.random.Generator) -> Numbers:
    """Mass, length, and stiffness by the first frequency [Hz]."""
    mass, length, hertz = log(chance, 0.1, 10.0), log(chance, 0.3, 3.0), log(chance, 2.0, 150.0)
    stiffness = (2 * np.pi * hertz / ROOTS[0] ** 2) ** 2 * mass * length**3
    damping = chance.choice([0.0, log(chance, 1e-3, 1e-1)])
    numbers = {"mass": mass, "length": length, "EI": stiffness, "damping": damping}
    # Of the beam: deflections at the ends of up to a fiftieth of its length; often none.
    bent = 0.02 * length * np.sqrt(mass) / 2 * chance.choice([0.0, 1.0])
    numbers["bent"] = bent * chance.uniform(-1.0, 1.0, 2)
    return {name: np.asarray(value) for name, value in numbers.items()}


def frequencies(p: Numbers) -> Any:
    """Of the free-free modes [rad/s]."""
    return ROOTS**2 * jnp.sqrt(p["EI"] / (p["mass"] * p["length"] ** 3))


def tip(p: Numbers) -> Any:
    """Deflections of the end with the larger coordinate in both modes; the other is mirrored."""
    return 2 / jnp.sqrt(p["mass"]) * jnp.array([1.0, -1.0])


def beam_energy(p: Numbers, x: Any, rate: Any) -> Any:
    """½ m |ẋ|² + ½ (J + |q|²) φ̇² + ½ |q̇|² of one row (x, y, φ, q₁, q₂)."""
    turning = p["mass"] * p["length"] ** 2 / 12 + jnp.sum(x[3:] ** 2)
    moving = p["mass"] * jnp.sum(rate[:2] ** 2) + jnp.sum(rate[3:] ** 2)
    return 0.5 * (moving + turning * rate[2] ** 2)


def bending(p: Numbers, x: Any) -> Any:
    """The elastic energy and the potential of the weight."""
    return 0.5 * jnp.sum((frequencies(p) * x[3:]) ** 2) + GRAVITY * p["mass"] * x[1]


def modal_damping(p: Numbers, t: Any, s: Any, rate: Any) -> Any:
    """On the first coordinate nothing, on the amplitudes −2 ζ ω q̇."""
    del t, s
    return jnp.append(0.0, -2 * p["damping"] * frequencies(p) * rate[1:])


def beam(p: Numbers, row: int) -> rj.Beam:
    x, v = p["x"][row], p["v"][row]
    start = {"position": x[:2], "angle": x[2], "velocity": v[:2], "angular_velocity": v[2]}
    return rj.Beam(
        "beam",
        p["mass"],
        p["length"],
        EI=p["EI"],
        modes=2,
        shapes="free-free",
        damping=jnp.stack([p["damping"]] * 2),
        amplitudes=x[3:],
        rates=v[3:],
        **start,
    )


# A pendulum; s = (φ, q₁, q₂).


def hung(p: Numbers, s: Any, at: Any) -> Any:
    """The row of a beam whose lower end is held at a point."""
    low = tip(p) * jnp.array([1.0, -1.0]) @ s[1:]
    across = jnp.stack([-jnp.sin(s[0]), jnp.cos(s[0])])
    middle = at + along(p["length"] / 2, s[0]) - low * across
    return jnp.concatenate([middle, s])


PENDULUM = Minimal(
    lambda p, t, s: hung(p, s, ZERO)[None],
    lambda p, x, rate: beam_energy(p, x[0], rate[0]),
    lambda p, t, s, x: bending(p, x[0]),
    modal_damping,
)


def draw_pendulum(chance: np.random.Generator) -> Numbers:
    p = draw_beam(chance)
    s = np.append(chance.uniform(-3.0, 0.0), p["bent"])
    ds = np.append(chance.uniform(-3.0, 3.0), ZERO)
    return PENDULUM.start({**p, "s": s, "ds": ds, "end": log(chance, 0.2, 1.5)})


def pendulum_scene(p: Numbers) -> rj.Scene:
    body = beam(p, 0)
    hinge = rj.Revolute(body.at("start"), rj.ground.at())
    return rj.Scene([body], [hinge], [rj.Gravity()])


# A slider-crank; s = (θ, q₁, q₂), rows are crank, rod and slider.


def slider_crank_places(p: Numbers, t: Any, s: Any) -> Any:
    """The end of the rod is on the x axis: y_A + L sin φ + (w_B − w_A) cos φ = 0."""
    del t
    crank = along(p["crank"], s[0])
    high = tip(p) @ s[1:]
    low = (tip(p) * jnp.array([1.0, -1.0])) @ s[1:]
    rise = high - low
    reach = jnp.sqrt(p["length"] ** 2 + rise**2)
    angle = -jnp.arcsin(crank[1] / reach) - jnp.arctan2(rise, p["length"])
    rod = hung(p, s.at[0].set(angle), crank)
    across = jnp.stack([-jnp.sin(angle), jnp.cos(angle)])
    end = rod[:2] + along(p["length"] / 2, angle) + high * across
    rows = [jnp.append(crank / 2, s[0]), rod, jnp.append(end, 0.0)]
    return jnp.stack([jnp.pad(row, (0, 5 - len(row))) for row in rows])


def slider_crank_energy(p: Numbers, x: Any, rate: Any) -> Any:
    turning = p["crank mass"] * p["crank"] ** 2 / 12 * rate[0, 2] ** 2
    rigid = p["crank mass"] * jnp.sum(rate[0, :2] ** 2) + turning
    rigid += p["slider mass"] * jnp.sum(rate[2, :2] ** 2)
    return 0.5 * rigid + beam_energy(p, x[1], rate[1])


SLIDER_CRANK = Minimal(
    slider_crank_places,
    slider_crank_energy,
    lambda p, t, s, x: bending(p, x[1]) + GRAVITY * p["crank mass"] * x[0, 1],
    modal_damping,
)


def draw_slider_crank(chance: np.random.Generator) -> Numbers:
    p = draw_beam(chance)
    crank = p["length"] * chance.uniform(0.1, 0.8)
    masses = {name: np.asarray(log(chance, 0.1, 10.0)) for name in ("crank mass", "slider mass")}
    s = np.append(chance.uniform(-3.0, 3.0), p["bent"])
    ds = np.append(chance.uniform(-12.0, 12.0), ZERO)
    start = {"s": s, "ds": ds, "crank": crank, "end": log(chance, 0.1, 1.0)}
    return SLIDER_CRANK.start({**p, **masses, **start})


def slider_crank_scene(p: Numbers) -> rj.Scene:
    xp = np if isinstance(p["crank"], float | np.ndarray) else jnp
    x, v, half = p["x"], p["v"], xp.stack([p["crank"] / 2, 0.0 * p["crank"]])
    crank, slider = (
        rj.RigidBody(
            name,
            p[f"{name} mass"],
            p[f"{name} mass"] * p["crank"] ** 2 / 12,
            position=x[row, :2],
            angle=x[row, 2],
            velocity=v[row, :2],
            angular_velocity=v[row, 2],
        )
        for name, row in (("crank", 0), ("slider", 2))
    )
    rod = beam(p, 1)
    joints = [
        rj.Revolute(crank.at(-half), rj.ground.at()),
        rj.Revolute(rod.at("start"), crank.at(half)),
        rj.Revolute(slider.at(), rod.at("end")),
        rj.Prismatic(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([crank, rod, slider], joints, [rj.Gravity()])


KINDS = {
    "beam": Kind(draw_pendulum, moved(pendulum_scene), PENDULUM.motion),
    "flexible rod": Kind(draw_slider_crank, moved(slider_crank_scene), SLIDER_CRANK.motion),
}
