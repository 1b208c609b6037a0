"""Elastic rods that bend far, from a millimetre to a kilometre: pendulums, and the rod of a
slider-crank; in the plane, and in a plane of space.

The truth is the motion in minimal coordinates, an angle and the Legendre coefficients of curvature,
by SciPy's DOP853 (`minimal.py`), with integrals along the rod of its own.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre
from scipy.spatial.transform import Rotation

import romjax as rj

from .kind import Kind, Numbers, moved
from .minimal import GRAVITY, Minimal
from .planar import along, log

MODES = 3
POINTS = 30  # along the rod
NODES, WEIGHTS = np.polynomial.legendre.leggauss(POINTS)
WEIGHTS = WEIGHTS / 2
FIT = (2 * np.arange(POINTS) + 1)[:, None] * legendre.legvander(NODES, POINTS - 1).T * WEIGHTS


def integral(count: int, to: np.ndarray) -> np.ndarray:
    """Of the first Legendre polynomials, from the start to the places `to` in −1 … 1."""
    columns = [legendre.legint(row, lbnd=-1) / 2 for row in np.eye(count)]
    return np.stack([legendre.legval(to, column) for column in columns], axis=1)


# At the middle, the points and the end.
PLACES = np.concatenate([[0.0], NODES, [1.0]])
TURNING, SUMS = integral(MODES, PLACES), integral(POINTS, PLACES) @ FIT


def shape(p: Numbers, c: Any) -> Any:
    """Places and angles (x, y, θ) of the middle, the points and the end in the frame of the start,
    for coefficients c of curvature times length.
    """
    angles = TURNING @ c
    tangents = jnp.stack([jnp.cos(angles[1:-1]), jnp.sin(angles[1:-1])], axis=1)
    return jnp.concatenate([p["length"] * SUMS @ tangents, angles[:, None]], axis=1)


def placed(p: Numbers, c: Any, at: Any, angle: Any) -> Any:
    """The rod whose start is at a point and turned by an angle."""
    own, (cos, sin) = shape(p, c), along(1.0, angle)
    turned = own[:, :2] @ jnp.array([[0.0, 1.0], [-1.0, 0.0]]) * sin + own[:, :2] * cos
    return jnp.concatenate([at + turned, own[:, 2:] + angle], axis=1)


def rod_energy(p: Numbers, x: Any, rate: Any) -> Any:
    del x
    return 0.5 * p["mass"] * jnp.sum(WEIGHTS[:, None] * rate[1 : 1 + POINTS, :2] ** 2)


def bending(p: Numbers, s: Any, x: Any) -> Any:
    """The elastic energy and the potential of the weight; coefficients come last in s."""
    elastic = p["EI"] / p["length"] * jnp.sum(s[-MODES:] ** 2 / (2 * np.arange(MODES) + 1))
    return 0.5 * elastic + GRAVITY * p["mass"] * WEIGHTS @ x[1 : 1 + POINTS, 1]


class Bent(Minimal):
    """With rows of the middle, the points and the end of the rod, of which the middle is seen, and
    of what comes after them.
    """

    def start(self, p: Numbers) -> Numbers:
        both = super().start(p)
        rows = [0, *range(2 + POINTS, len(both["x"]))]
        return {**p, "x": both["x"][rows], "v": both["v"][rows]}

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        found = super().motion(p, nudge)
        return np.concatenate([found[:, :2], found[:, 2 * (2 + POINTS) :]], axis=1)


def draw_rod(chance: np.random.Generator, stiff: tuple[float, float]) -> Numbers:
    """Its weight bends it by `stiff`; "unit" is a time of its swing."""
    mass, length = log(chance, 0.1, 10.0), log(chance, 1e-3, 1e3)
    numbers = {
        "mass": mass,
        "length": length,
        "EI": mass * GRAVITY * length**2 * log(chance, *stiff),
        "unit": np.sqrt(length / GRAVITY),
    }
    return {name: np.asarray(value) for name, value in numbers.items()}


def bent_by(p: Numbers, basis: Any) -> dict[str, Any]:
    """The amplitudes and rates of a rod whose coefficients are the last of the start."""
    xp = jnp if isinstance(p["s"], jax.Array) else np
    both = (p[name][-MODES:] for name in ("s", "ds"))
    columns = (xp.concatenate([xp.zeros(len(basis) - MODES), x]) for x in both)
    return dict(
        zip(("amplitudes", "rates"), (xp.linalg.solve(basis, x) for x in columns), strict=True)
    )


def rod(p: Numbers) -> rj.Rod:
    x, v = p["x"][0], p["v"][0]
    start = {"position": x[:2], "angle": x[2], "velocity": v[:2], "angular_velocity": v[2]}
    own = "rod", p["mass"], p["length"], p["EI"], MODES
    return rj.Rod(*own, **start, **bent_by(p, rj.Rod(*own).strains.basis))


# Pendulums; s = (φ, c).

PENDULUM = Bent(
    lambda p, t, s: placed(p, s[1:], jnp.zeros(2), s[0]),
    rod_energy,
    lambda p, t, s, x: bending(p, s, x),
)


def draw_pendulum(chance: np.random.Generator) -> Numbers:
    p = draw_rod(chance, (0.01, 3.0))
    s = np.append(chance.uniform(-3.0, 3.0), chance.choice([0.0, 0.5]) * chance.normal(size=MODES))
    ds = np.append(chance.uniform(-2.0, 2.0), chance.uniform(-0.5, 0.5, MODES)) / p["unit"]
    return PENDULUM.start({**p, "s": s, "ds": ds, "end": p["unit"] * log(chance, 0.3, 5.0)})


def pendulum_scene(p: Numbers) -> rj.Scene:
    body = rod(p)
    return rj.Scene([body], [rj.Revolute(body.at("start"), rj.ground.at())], [rj.Gravity()])


# The same in a plane of space, whose rod can twist and leave it.


def draw_in_space(chance: np.random.Generator) -> Numbers:
    return {**draw_pendulum(chance), "frame": Rotation.random(rng=chance).as_matrix()}


def in_space_scene(p: Numbers) -> rj.Scene:
    xp = jnp if isinstance(p["frame"], jax.Array) else np
    frame, x, v = p["frame"], p["x"][0], p["v"][0]
    c, s, none = xp.cos(x[2]), xp.sin(x[2]), 0.0 * x[2]
    turned = [[c, -s, none], [s, c, none], [none, none, 1.0 + none]]
    rotary = 1e-3 * p["mass"] * p["length"] * np.array([1.0, 0.0, 0.0])
    own = "rod", p["mass"], p["length"], p["EI"], p["EI"], rotary, 3 * MODES
    basis = rj.spatial.Rod(*own).strains.basis.reshape(-1, 3 * MODES)
    body = rj.spatial.Rod(
        *own,
        position=frame[:, :2] @ x[:2],
        orientation=frame @ xp.stack([xp.stack(row) for row in turned]),
        velocity=frame[:, :2] @ v[:2],
        angular_velocity=v[2] * frame[:, 2],
        **bent_by(p, basis),
    )
    start, up = p["length"] * np.array([-0.5, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    at = rj.ground.at((0.0, 0.0, 0.0), axis=frame[:, 2])
    hinge = rj.spatial.Revolute(body.at(start, axis=up), at)
    return rj.Scene([body], [hinge], [rj.Gravity(-GRAVITY * frame[:, 1])])


def in_space_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    own = {name: value for name, value in p.items() if name != "frame"}
    return PENDULUM.motion(own, nudge) @ p["frame"][:, :2].T


# Slider-cranks; s = (θ, c), rows are the rod, the crank and the slider.


def slider_crank_places(p: Numbers, t: Any, s: Any) -> Any:
    """The end of the rod is on the x axis: a sin θ + |d| sin(φ + δ) = 0, with its chord d."""
    del t
    crank, chord = along(p["crank"], s[0]), shape(p, s[1:])[-1]
    size, slope = jnp.hypot(chord[0], chord[1]), jnp.arctan2(chord[1], chord[0])
    rows = placed(p, s[1:], crank, -jnp.arcsin(crank[1] / size) - slope)
    slider = jnp.stack([rows[-1, 0], 0.0 * s[0], 0.0 * s[0]])
    return jnp.concatenate([rows, jnp.append(crank / 2, s[0])[None], slider[None]])


def slider_crank_energy(p: Numbers, x: Any, rate: Any) -> Any:
    crank, slider = rate[-2], rate[-1]
    turning = p["crank mass"] * p["crank"] ** 2 / 12 * crank[2] ** 2
    rigid = p["crank mass"] * crank[:2] @ crank[:2] + turning + p["slider mass"] * slider[0] ** 2
    return 0.5 * rigid + rod_energy(p, x, rate)


SLIDER_CRANK = Bent(
    slider_crank_places,
    slider_crank_energy,
    lambda p, t, s, x: bending(p, s, x) + GRAVITY * p["crank mass"] * x[-2, 1],
)


def draw_slider_crank(chance: np.random.Generator) -> Numbers:
    p = draw_rod(chance, (0.1, 3.0))
    crank = p["length"] * chance.uniform(0.1, 0.5)
    masses = {
        name: p["mass"] * np.asarray(log(chance, 0.3, 3.0))
        for name in ("crank mass", "slider mass")
    }
    s = np.append(chance.uniform(-3.0, 3.0), chance.choice([0.0, 0.2]) * chance.normal(size=MODES))
    ds = np.append(chance.uniform(-3.0, 3.0), np.zeros(MODES)) / p["unit"]
    end = p["unit"] * log(chance, 0.3, 2.0)
    return SLIDER_CRANK.start({**p, **masses, "s": s, "ds": ds, "crank": crank, "end": end})


def slider_crank_scene(p: Numbers) -> rj.Scene:
    xp = jnp if isinstance(p["crank"], jax.Array) else np
    half, middle = xp.stack([p["crank"] / 2, 0.0 * p["crank"]]), rod(p)
    crank, slider = (
        rj.RigidBody(
            name,
            p[f"{name} mass"],
            p[f"{name} mass"] * p["crank"] ** 2 / 12,
            position=p["x"][row, :2],
            angle=p["x"][row, 2],
            velocity=p["v"][row, :2],
            angular_velocity=p["v"][row, 2],
        )
        for name, row in (("crank", 1), ("slider", 2))
    )
    joints = [
        rj.Revolute(crank.at(-half), rj.ground.at()),
        rj.Revolute(middle.at("start"), crank.at(half)),
        rj.Revolute(slider.at(), middle.at("end")),
        rj.Prismatic(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([middle, crank, slider], joints, [rj.Gravity()])


KINDS = {
    "rod": Kind(draw_pendulum, moved(pendulum_scene), PENDULUM.motion),
    "rod in space": Kind(draw_in_space, moved(in_space_scene), in_space_motion),
    "rod in a loop": Kind(draw_slider_crank, moved(slider_crank_scene), SLIDER_CRANK.motion),
}
