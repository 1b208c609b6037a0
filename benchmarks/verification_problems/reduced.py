"""Published problems by reduced models, and what decompositions find."""

import functools

import numpy as np
import scipy.linalg

import romjax as rj
from romjax import gallery

from . import simeon
from .plane import bar, ends
from .points import SCIPY, on_a_link, swinging
from .problem import G, Problem, integrated, named, run

SIMEON = "Simeon 1996, Mathematical Modelling of Systems 2; problem crank of the IVP test set"
ORDER24 = ("extrapolation of order 24 in 18 digits", "the same with another number of steps")


def by_hinges() -> np.ndarray:
    """The pendulum in coordinates of its joint, none of which is constrained."""
    one = rj.RigidBody("bob", 1.0, 1e-12, position=(1.0, 0.0), extent=(2.0, 0.05))
    hinge = rj.Revolute(one.at((-1.0, 0.0)), rj.ground.at())
    system = rj.assemble(rj.Scene([one], [hinge], [rj.Gravity()]))
    rom = rj.reduce(system, formulation=rj.JointCoordinates())
    return np.asarray(run(rom, 0.0, 10.0).q)[-1, :2]


def by_minimal() -> np.ndarray:
    """The pendulum in one coordinate, over charts, of a basis of its run."""
    system = rj.assemble(on_a_link())
    truth = run(system, *np.linspace(0.0, 1.0, 51))
    formulation = rj.Minimal()
    rom = rj.reduce(system, formulation.basis(system, truth, rj.POD(rank=2)), formulation)
    return np.asarray(run(rom, 0.0, 10.0).q)[-1, :2]


def bars() -> rj.Scene:
    links = [bar("upper", (0, 0), (1, 0), 1.0), bar("lower", (1, 0), (2, 0), 1.0)]
    hinges = [
        rj.Revolute(ends(links[0])[0], rj.ground.at()),
        rj.Revolute(ends(links[1])[0], ends(links[0])[1]),
    ]
    return rj.Scene(links, hinges, [rj.Gravity()])


@functools.cache
def bars_right() -> np.ndarray:
    """Lagrange's equations of both absolute angles after two seconds."""

    def slope(_, y):
        a, b, u, w = y
        c, s = np.cos(a - b) / 2, np.sin(a - b) / 2
        mass = np.array([[4 / 3, c], [c, 1 / 3]])
        force = [-1.5 * G * np.cos(a) - s * w**2, -0.5 * G * np.cos(b) + s * u**2]
        return [u, w, *np.linalg.solve(mass, force)]

    return integrated(slope, [0.0, 0.0, 0.0, 0.0], 0.0, 2.0)[-1, :2]


def bars_found() -> np.ndarray:
    rom = rj.reduce(rj.assemble(bars()), formulation=rj.JointCoordinates())
    return np.asarray(run(rom, 0.0, 2.0).q)[-1, [2, 5]]


def bars_again() -> np.ndarray:
    """Places and multipliers, by SciPy, in redundant coordinates."""

    def slope(_, y):
        q, v = y[:6].reshape(2, 3), y[6:].reshape(2, 3)
        c, s = 0.5 * np.cos(q[:, 2]), 0.5 * np.sin(q[:, 2])
        rows = np.array(
            [
                [1, 0, s[0], 0, 0, 0],
                [0, 1, -c[0], 0, 0, 0],
                [-1, 0, s[0], 1, 0, s[1]],
                [0, -1, -c[0], 0, 1, -c[1]],
            ]
        )
        w = v[:, 2] ** 2
        bend = np.array(
            [c[0] * w[0], s[0] * w[0], c[0] * w[0] + c[1] * w[1], s[0] * w[0] + s[1] * w[1]]
        )
        inverse = np.diag(1 / np.tile([1.0, 1.0, 1 / 12], 2))
        force = np.tile([0.0, -G, 0.0], 2)
        free = inverse @ force
        pull = np.linalg.solve(rows @ inverse @ rows.T, rows @ free + bend)
        return [*y[6:], *(free - inverse @ rows.T @ pull)]

    start = [0.5, 0, 0, 1.5, 0, 0, *np.zeros(6)]
    return integrated(slope, start, 0.0, 2.0)[-1, [2, 5]]


def simeon_scene() -> rj.Scene:
    """A flexible rod by its inertia invariants, hinged to a driven crank and a slider."""
    crank = rj.RigidBody("crank", 0.36, simeon.CRANK, angular_velocity=simeon.SPEED)
    rod = simeon.rod()
    slider = rj.RigidBody(
        "slider", 0.075552, 1e-3, position=(simeon.START[2], 0.0), velocity=(simeon.RATES[2], 0.0)
    )
    joints = [
        rj.Revolute(crank.at(), rj.ground.at()),
        rj.PrescribedAngle(crank.at(), rj.ground.at(), rj.Ramp(simeon.SPEED)),
        rj.Revolute(rod.at("crank"), crank.at((0.15, 0.0))),
        rj.Revolute(rod.at("slider"), slider.at()),
        rj.Prismatic(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([crank, rod, slider], joints)


def simeon_found() -> np.ndarray:
    """The start has nine digits: velocities are projected, positions are not, as in the index two
    of the reference; unstabilised, so that what is left of C stays.
    """
    system = rj.assemble(simeon_scene())
    q, v = simeon.projected(system)
    settings = {"atol": 1e-15, "stabilization": None, "throw": False}
    made = run(system, 0.0, 0.1, q0=q, v0=v, **settings)
    return np.asarray(made.q)[-1, [5, 10, 6, 7, 8, 9]]


def crank_by_galerkin() -> list[float]:
    """The gallery's slider crank by six modes of its own run."""
    example = gallery.find("slider-crank")
    system = rj.assemble(example.make())
    ts = np.linspace(0.0, 0.1, 401)
    truth = rj.simulate(system, ts, rtol=1e-9, solver=example.solver)
    rom = rj.reduce(system, rj.pod(truth, rank=6), "galerkin")
    made = rj.simulate(rom, ts, rtol=1e-9)
    return [np.asarray(made[label])[-1] for label in ("rod.phi", "slider.x")]


class Recorded:
    """A motion of a linear system."""

    def __init__(self, t, q, v, metric):
        self.t, self.q, self.v, self.metric = t, q, v, metric
        self.labels = tuple(f"x{i}" for i in range(q.shape[1]))


def vibration(t, mass, frequencies, modes, damping, place, speed) -> Recorded:
    """Free vibration from modal coordinates and velocities, in closed form."""
    turning = frequencies * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * np.outer(t, frequencies))
    c, s = np.cos(np.outer(t, turning)), np.sin(np.outer(t, turning))
    sine = (speed + damping * frequencies * place) / turning
    x = decay * (place * c + sine * s)
    v = decay * turning * (sine * c - place * s) - damping * frequencies * x
    return Recorded(t, x @ modes.T, v @ modes.T, mass)


def building(n=24) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of so many storeys."""
    stiffness = 900 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[-1, -1] = 900
    return np.diag(1.0 + 0.05 * np.arange(n)), stiffness


def of_a_building(n=24) -> rj.Basis:
    """Smooth orthogonal modes. Starts of unit energy in each storey's spring and mass make
    Σ_xx = K⁻¹ and Σ_vv = M⁻¹ at every time, so a second is enough.
    """
    mass, stiffness = building(n)
    squares, modes = scipy.linalg.eigh(stiffness, mass)
    w, t = np.sqrt(squares), np.linspace(0, 1, 101)
    runs = []
    for start in np.sqrt(mass) @ modes:
        for place, speed in ((start / w, 0 * w), (0 * w, start)):
            runs.append(vibration(t, mass, w, modes, 0.0, place, speed))
    return rj.sod(runs, rank=n, offset=np.zeros(n))


def storeys() -> np.ndarray:
    """The first three and the last frequency, by a tridiagonal eigenproblem."""
    mass, stiffness = building()
    scaled = stiffness / np.sqrt(np.outer(np.diag(mass), np.diag(mass)))
    found = scipy.linalg.eigvalsh_tridiagonal(np.diag(scaled), np.diag(scaled, 1))
    return np.sqrt(found[[0, 1, 2, -1]])


def storeys_found() -> np.ndarray:
    return np.sort(1 / np.sqrt(np.asarray(of_a_building().values)))[[0, 1, 2, -1]]


def storeys_again() -> np.ndarray:
    mass, stiffness = building()
    return np.sqrt(scipy.linalg.eigvalsh(stiffness, mass))[[0, 1, 2, -1]]


PLACE = "x [m], y [m]"
PENDULUM = ("Jacobi's elliptic functions", "22 digits in multiple precision, as stored")


def at_ten() -> list[float]:
    return [0.2750874625761168600544, -0.9614192050991250642651]


PROBLEMS = (
    Problem(
        "pendulum by its joint",
        "The point pendulum after 10 s in the coordinate of its hinge, without constraints.",
        "IFToMM library of computational benchmark problems, problem A01",
        lambda: named(PLACE, swinging(10.0)[:2]),
        PENDULUM,
        by_hinges,
        at_ten,
        scene=on_a_link,
    ),
    Problem(
        "pendulum in minimal coordinates",
        "The same by a basis of its first second, over as many charts as its circle takes.",
        "IFToMM library of computational benchmark problems, problem A01",
        lambda: named(PLACE, swinging(10.0)[:2]),
        PENDULUM,
        by_minimal,
        at_ten,
        scale=1.0,
        scene=on_a_link,
    ),
    Problem(
        "double pendulum by its joints",
        "Two uniform bars of 1 m, released from the level: both angles after 2 s.",
        "own definition",
        lambda: named("upper [rad], lower [rad]", bars_right()),
        (SCIPY.format("two angles"), "the same in six coordinates with multipliers"),
        bars_found,
        bars_again,
        scene=bars,
    ),
    Problem(
        "flexible slider crank",
        "A crank that turns by 150 rad/s, a rod of two sines across and two elements along, and a\n"
        "slider: rod, slider and the four deflections after 0.1 s, 400 periods of the fastest.",
        SIMEON,
        lambda: named(
            "rod [rad], slider [m], first sine [m], second sine [m], middle [m], end [m]",
            simeon.POSITIONS[1:],
        ),
        ORDER24,
        simeon_found,
        scene=simeon_scene,
    ),
    Problem(
        "flexible slider crank by six modes",
        "The same by the gallery's scene and Galerkin's method with six modes of its run.",
        SIMEON,
        lambda: named("rod [rad], slider [m]", simeon.POSITIONS[1:3]),
        ORDER24,
        crank_by_galerkin,
        scene=gallery.slider_crank,
    ),
    Problem(
        "frequencies of a building",
        "Smooth orthogonal values of motions of 24 storeys are 1/ω²: three lowest frequencies\n"
        "and the highest.",
        "Chelidze and Zhou 2006",
        lambda: named("first [rad/s], second [rad/s], third [rad/s], last [rad/s]", storeys()),
        ("eigenvalues of a tridiagonal matrix", "the generalised eigenproblem of M and K"),
        storeys_found,
        storeys_again,
    ),
)
