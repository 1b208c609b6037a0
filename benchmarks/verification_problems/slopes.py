"""Derivatives of motions, equilibria, frequencies and times of events."""

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj

from .problem import G, Problem, named
from .small import ABOUT, ARM, MASS

SPRUNG = (0.33344810612843791, -0.36375403397094977)


def slider_crank(k, c) -> rj.CustomSystem:
    """SUNDIALS's example idasSlCrank: crank angle, slider, rod angle; a spring and a damper."""
    a, J1, m2, J2, l0, F = 0.5, 1.0, 1.0, 2.0, 1.0, 1.0

    def force(t, r, v):
        (q, x, p), (qd, xd, pd) = r, v
        s1, c1, s2, c2 = jnp.sin(q), jnp.cos(q), jnp.sin(p), jnp.cos(p)
        s21, c21 = s2 * c1 - c2 * s1, c2 * c1 + s2 * s1
        length = jnp.sqrt(x**2 - x * (c2 + a * c1) + (1 + a**2) / 4 + a * c21 / 2)
        rate = 2 * x * xd - xd * (c2 + a * c1) + x * (s2 * pd + a * s1 * qd)
        rate = (rate - a * s21 * (pd - qd) / 2) / (2 * length)
        fl = (k * (length - l0) + c * rate) / length
        return jnp.stack(
            [
                -fl * a * (s21 / 2 + x * s1) / 2,
                fl * (c2 / 2 - x + a * c1 / 2) + F,
                -fl * (x * s2 - a * s21 / 2) / 2 - F * s2,
            ]
        )

    p = -jnp.pi / 6
    return rj.CustomSystem(
        lambda r: jnp.diag(jnp.array([J1, m2, J2])),
        force,
        lambda t, r: jnp.stack(
            [r[1] - jnp.cos(r[2]) - a * jnp.cos(r[0]), -jnp.sin(r[2]) - a * jnp.sin(r[0])]
        ),
        q0=jnp.stack([jnp.pi / 2, jnp.cos(p), p]),
        v0=jnp.zeros(3),
    )


def work(x):
    """G = ∫ T dt over 10 s, by Gauss's rule on the outputs."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ts = np.append(0.0, 5 * (nodes + 1))
    keep = rj.Baumgarte(alpha=12.0, beta=36.0)
    settings = {"rtol": 1e-10, "stabilization": keep, "audit": False}
    motion = rj.simulate(slider_crank(x[0], x[1]), ts, **settings)
    kinetic = 0.5 * jnp.sum(np.array([[1.0, 1.0, 2.0]]) * motion.v[1:] ** 2, axis=1)
    return 5 * weights @ kinetic


def by_both() -> jax.Array:
    with rj.forward_mode():
        return jax.jit(jax.jacfwd(work))(jnp.array([1.0, 1.0]))


def hung(stiffness) -> rj.AbstractSystem:
    """A mass of 2 kg below a spring without length."""
    body = rj.RigidBody("mass", 2.0, 0.1)
    spring = rj.Spring(body.at(), rj.ground.at((0.0, 1.0)), stiffness)
    return rj.assemble(rj.Scene([body], [], [rj.Gravity((0.0, -G)), spring]))


def swinging(stiffness) -> rj.AbstractSystem:
    """A bar that hangs, with a torsion spring at its hinge."""
    bar = rj.RigidBody("bar", MASS, 0.11, position=(0.0, -ARM), angle=-np.pi / 2)
    hinge = rj.Revolute(bar.at((-ARM, 0.0)), rj.ground.at())
    spring = rj.TorsionSpring(bar.at(), rj.ground.at(), stiffness, -np.pi / 2)
    return rj.assemble(rj.Scene([bar], [hinge], [rj.Gravity((0.0, -G)), spring]))


def both(function, at: float) -> list[float]:
    """Forward and reverse."""
    at = jnp.asarray(at)
    with rj.forward_mode():
        forward = jax.jit(jax.jacfwd(function))(at)
    return [forward, jax.jit(jax.grad(function))(at)]


def differenced(function, at: float) -> list[float]:
    """Central differences of order four of a closed form."""
    h = 1e-3 * at
    near, far = (function(at + k * h) - function(at - k * h) for k in (1, 2))
    return 2 * [(8 * near - far) / (12 * h)]


def height(system, t, q, v):
    return q[0]


def landing(g):
    """When a ball that is dropped by a metre lands, of a run with an event."""
    falling = rj.CustomSystem(
        lambda q: jnp.eye(1), lambda t, q, v: -g * jnp.ones(1), q0=[1.0], v0=[0.0]
    )
    settings = {"events": [rj.Crossing(height)], "rtol": 1e-10, "audit": False}
    return rj.simulate(falling, np.array([0.0, 1.0]), **settings).events.time[0]


def stiff(k):
    return np.sqrt((k + MASS * G * ARM) / ABOUT)


NAMES = "forward, reverse"
BY_HAND = ("derivative of the closed form", "differences of order four of it")

PROBLEMS = (
    Problem(
        "gradient of a slider crank",
        "G, the integral of the kinetic energy of SUNDIALS' slider crank over 10 s: its\n"
        "derivatives by the stiffness and the damping of the spring.",
        "SUNDIALS, example idasSlCrank_FSA of IDAS (Serban, Petra)",
        lambda: named("by stiffness, by damping", SPRUNG),
        ("extrapolation in 54 digits with sensitivities", "the published values, four digits"),
        by_both,
        lambda: [0.33346, -0.36375],
    ),
    Problem(
        "slope of an equilibrium",
        "The height of 2 kg on a spring of 50 N/m, by its stiffness: m g / k².",
        "closed form",
        lambda: named(NAMES, 2 * [2 * G / 50.0**2]),
        BY_HAND,
        lambda: both(lambda k: rj.equilibrium(hung(k))[1], 50.0),
        lambda: differenced(lambda k: 1 - 2 * G / k, 50.0),
    ),
    Problem(
        "slope of a frequency",
        "The frequency of a bar on a hinge, by the stiffness of its torsion spring.",
        "closed form",
        lambda: named(NAMES, 2 * [0.5 / np.sqrt((2.0 + MASS * G * ARM) * ABOUT)]),
        BY_HAND,
        lambda: both(lambda k: rj.modes(swinging(k)).frequencies[0], 2.0),
        lambda: differenced(stiff, 2.0),
    ),
    Problem(
        "slope of the time of an event",
        "When a ball that falls by a metre lands, by gravity: −√(h / 2 g³).",
        "closed form",
        lambda: named(NAMES, 2 * [-np.sqrt(1 / (2 * G**3))]),
        BY_HAND,
        lambda: both(landing, G),
        lambda: differenced(lambda g: np.sqrt(2 / g), G),
    ),
)
