"""Rods that bend far, and columns that give way."""

import jax.numpy as jnp
import numpy as np
import scipy.integrate
import scipy.linalg
import scipy.optimize
import scipy.special
from jaxtyping import Array, Float

import romjax as rj
from romjax.scene.fields import number

from .problem import Problem, named, run

# A cantilever under a dead load across its tip, P L²/EI: angle, deflection and shortening, each in
# units of the length, by elliptic integrals (Bisshopp and Drucker 1945, doi:10.1090/qam/13360).
ELASTICA = {
    1.0: (0.461351949712, 0.301720773800, 0.0564332362834),
    2.0: (0.781749831557, 0.493457480397, 0.160641720825),
    5.0: (1.215368117612, 0.713791523612, 0.387628360725),
    10.0: (1.43028553880385753, 0.81060902488029645, 0.55499559775375127),
}
ORIGIN = (0.0, 0.0)


def cantilever(modes=10, load=None, gravity=0.0, **options) -> rj.Scene:
    """A straight rod of one metre, one kilogram and EI = 1, clamped to the ground, under the `load`
    of a function of the marker at its tip, and gravity against its axis.
    """
    blade = rj.Rod("blade", 1.0, 1.0, 1.0, modes, **options)
    blade = blade.placed("start", rj.ground.pose(ORIGIN))
    clamp = rj.Weld(blade.at("start"), rj.ground.at(ORIGIN))
    effects = [load(blade.at("end"))] if load else []
    return rj.Scene([blade], [clamp], [*effects, rj.Gravity((-gravity, 0.0))])


def across(load: float):
    return lambda at: rj.Force(at, (0.0, 1.0), rj.Constant(load))


def torque(turn: float):
    return lambda at: rj.Torque(at, rj.Constant(turn))


def tip(scene: rj.Scene) -> np.ndarray:
    """Angle, deflection and shortening of a cantilever in equilibrium, from the straight start."""
    q = rj.equilibrium(rj.assemble(scene))
    (rod,) = scene.bodies
    end = rod.started(q, np.zeros_like(q)).pose("end")
    x, y = np.asarray(end.position)
    return np.array([end.angle, y, rod.length - x])


def shot(load: float) -> np.ndarray:
    """θ'' = −P cos θ from θ = 0 to θ' = 0, by shooting for the curvature of the root."""

    def end(root):
        def slope(_, y):
            return [y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

        settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
        return scipy.integrate.solve_ivp(slope, (0, 1), [0, root, 0, 0], **settings).y[:, -1]

    root = scipy.optimize.brentq(lambda x: end(x)[1], 0.5 * min(load, 2.0), load, xtol=1e-14)
    angle, _, x, y = end(root)
    return np.array([angle, y, 1 - x])


def elastica(load: float) -> Problem:
    return Problem(
        f"elastica at {load:g}",
        "An inextensible cantilever under a dead load across its tip,\n"
        f"P L²/EI = {load:g}: angle, deflection and shortening in units of its length.",
        "Bisshopp and Drucker 1945, doi:10.1090/qam/13360",
        lambda: named("angle [rad], deflection, shortening", ELASTICA[load]),
        ("elliptic integrals", "shooting for the curvature of the root, SciPy's DOP853 at 1e-13"),
        lambda: tip(cantilever(10, across(load))),
        lambda: shot(load),
        scene=lambda: cantilever(10, across(load)),
    )


def flexible_pendulum(modes=12) -> rj.Scene:
    """A rod of 1 m and 1 kg that bends, stretches and shears, hinged at the origin, level."""
    rod = rj.Rod(
        "rod", 1.0, 1.0, 1.0, modes, EA=2e3, GA=1e3, rotary=1e-3, shapes="pinned-free"
    ).placed("start", rj.ground.pose(ORIGIN))
    hinge = rj.Revolute(rod.at("start"), rj.ground.at(ORIGIN))
    return rj.Scene([rod], [hinge], [rj.Gravity()])


def flexible_pendulum_found() -> np.ndarray:
    scene = flexible_pendulum()
    system = rj.assemble(scene)
    made = run(system, 0.0, 0.25, 0.5, 1.0, rtol=1e-8)
    return np.asarray(rj.measure(system, made, scene.bodies[0].at("end")).position)[1:].ravel()


class Pulse(rj.AbstractSignal):
    """size · sin²(π t / 2.5) until 2.5 s."""

    size: Float[Array, ""] = number()

    def __call__(self, t):
        return jnp.where(t < 2.5, self.size * jnp.sin(jnp.pi * t / 2.5) ** 2, 0.0)


def flying() -> rj.Scene:
    """A beam of 10 m in free flight, pushed and turned at its lower end until 2.5 s."""
    beam = rj.Rod(
        "beam", 10.0, 10.0, 500.0, 30, EA=1e4, GA=1e4, rotary=10.0, angle=np.arctan2(8.0, -6.0)
    ).placed("start", rj.ground.pose((6.0, 0.0)))
    lower = beam.at("start")
    return rj.Scene(
        [beam], [], [rj.Force(lower, (1.0, 0.0), Pulse(16.0)), rj.Torque(lower, Pulse(-160.0))]
    )


def flying_found() -> np.ndarray:
    scene = flying()
    system = rj.assemble(scene)
    made = run(system, 0.0, 2.5, 5.0, rtol=1e-8)
    (beam,) = scene.bodies
    places = [rj.measure(system, made, beam.at(name)).position for name in ("end", "start")]
    return np.concatenate(places, axis=1)[1:].ravel()


def thick(load=600e3) -> rj.Scene:
    """A cantilever of 5 m that bends, stretches and shears, under a load across its tip."""
    rod = rj.Rod("rod", 1.0, 5.0, 9.346e6, 24, EA=4.8e8, GA=3.231e8, rotary=1e-3)
    rod = rod.placed("start", rj.ground.pose(ORIGIN))
    clamp = rj.Weld(rod.at("start"), rj.ground.at(ORIGIN))
    return rj.Scene([rod], [clamp], [across(load)(rod.at("end"))])


SPECTRAL = ("an independent spectral code", "the same code with more points; six digits stay")

PROBLEMS = (
    *(elastica(load) for load in ELASTICA),
    Problem(
        "rod that is rolled up",
        "A torque of 2π EI/L at the tip of a cantilever rolls it up to one circle:\n"
        "the tip is back at the root, turned by 2π.",
        "closed form",
        lambda: named("angle [rad], deflection, shortening", [2 * np.pi, 0.0, 1.0]),
        ("closed form", "the integral of the tangent, by SciPy"),
        lambda: tip(cantilever(4, torque(2 * np.pi))),
        lambda: [
            2 * np.pi,
            scipy.integrate.quad(lambda s: np.sin(2 * np.pi * s), 0, 1)[0],
            1 - scipy.integrate.quad(lambda s: np.cos(2 * np.pi * s), 0, 1)[0],
        ],
        scale=1.0,
        scene=lambda: cantilever(4, torque(2 * np.pi)),
    ),
    Problem(
        "cantilever that shears",
        "A cantilever of 5 m with EA 4.8e8 N, GA 3.231e8 N and EI 9.346e6 N m² under a dead load\n"
        "of 600 kN: rotation, deflection and shortening of its tip.",
        "Gérardin and Cardona's cantilever; values of Simpson and Palacios 2013",
        lambda: named(
            "angle [rad], deflection [m], shortening [m]",
            [0.6720060638, 2.1596938945, 0.5964712722],
        ),
        ("shooting at 1e-12", "the published values, to their four digits"),
        lambda: tip(thick()),
        lambda: [0.6720, 2.159, 0.596],
        scene=thick,
    ),
    Problem(
        "very flexible pendulum",
        "A rod of 1 m, 1 kg and 1 N m² falls from the level; its tip turns four to five times\n"
        "in a second. The place of the tip at 0.25, 0.5 and 1 s.",
        "own definition",
        lambda: named(
            "x (0.25 s) [m], y (0.25 s) [m], x (0.5 s) [m], y (0.5 s) [m], "
            "x (1 s) [m], y (1 s) [m]",
            [0.913545, -0.403902, -0.042297, -1.003918, -0.990246, 0.044155],
        ),
        SPECTRAL,
        flexible_pendulum_found,
        scale=1.0,
        scene=flexible_pendulum,
    ),
    Problem(
        "beam in free flight",
        "A beam of 10 m and 500 N m², pushed and turned at its lower end by smooth pulses.\n"
        "Both ends at 2.5 and 5 s.",
        "after Simo and Vu-Quoc 1988, with smooth pulses",
        lambda: named(
            "upper x (2.5 s) [m], upper y (2.5 s) [m], lower x (2.5 s) [m], lower y (2.5 s) [m], "
            "upper x (5 s) [m], upper y (5 s) [m], lower x (5 s) [m], lower y (5 s) [m]",
            [
                *(5.418225, 8.784198, 3.805493, -0.554673),
                *(14.936775, 4.566522, 6.724210, 6.384875),
            ],
        ),
        SPECTRAL,
        flying_found,
        scale=10.0,
        scene=flying,
    ),
)
