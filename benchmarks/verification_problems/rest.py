"""What is at rest: equilibria in the plane and in space."""

import numpy as np
import scipy.optimize

import romjax as rj
from romjax import spatial

from .plane import bar, ends
from .problem import G, Problem, named

MOMENTS = "balance of forces and moments, closed form"
ENERGY = "the least potential energy, by SciPy"
LENGTH, MASS, EI = 1.3, 0.7, 3.0  # of the cantilevers


def least(energy, low: float, high: float) -> float:
    """Where an energy is least; Newton's method refines what its values alone cannot tell."""
    found = scipy.optimize.minimize_scalar(energy, bounds=(low, high), method="bounded")
    step = 1e-4
    at = [energy(found.x + k * step) for k in (-2, -1, 0, 1, 2)]
    slope = (at[0] - 8 * at[1] + 8 * at[3] - at[4]) / (12 * step)
    bend = (-at[0] + 16 * at[1] - 30 * at[2] + 16 * at[3] - at[4]) / (12 * step**2)
    return found.x - slope / bend


def on_springs(place, mass, springs, direction, push, gravity) -> rj.Scene:
    """A mass at (0, `place`) on springs, each with its anchor, stiffness and rest length, under a
    force that is given.
    """
    body = rj.RigidBody("mass", mass, 0.1, position=(0.0, place))
    hold = [rj.Spring(body.at(), rj.ground.at(at), k, rest_length=rest) for at, k, rest in springs]
    force = rj.Force(body.at(), direction, rj.Constant(push))
    return rj.Scene([body], [], [rj.Gravity((0.0, -gravity)), *hold, force])


def truss(load=15.0) -> rj.Scene:
    """Two springs to a mass above them, which snaps through under a load."""
    length = np.hypot(1.0, 0.4)
    springs = [((x, 0.0), 1000.0, length) for x in (-1.0, 1.0)]
    return on_springs(0.4, 1.0, springs, (0.0, -1.0), load, 0.0)


def truss_right() -> np.ndarray:
    def pull(y):
        stretched = np.hypot(1.0, y)
        return 2 * 1000.0 * (np.hypot(1.0, 0.4) - stretched) * y / stretched

    def root(load, low, high):
        return scipy.optimize.brentq(lambda y: pull(y) - load, low, high, xtol=1e-15)

    return np.array([root(15.0, 0.25, 0.4), root(40.0, -1.0, -0.4)])


def truss_again() -> list[float]:
    def energy(load):
        return lambda y: 1000.0 * (np.hypot(1.0, y) - np.hypot(1.0, 0.4)) ** 2 + load * y

    return [least(energy(15.0), 0.25, 0.5), least(energy(40.0), -1.0, -0.4)]


SPAN = np.array([2.4, 0.1])  # from end to end of the chain


def hanging_chain() -> rj.Scene:
    """Three bars of one metre between two points of the ground, not yet in balance."""
    first = np.array([0.8, -0.6])
    half = (SPAN - first) / 2
    height = np.sqrt(1 - half @ half)
    knee = first + half + height * np.array([half[1], -half[0]]) / np.sqrt(half @ half)
    points = [np.zeros(2), first, knee, SPAN]
    links = [bar(f"bar{i}", points[i], points[i + 1], 1.0) for i in range(3)]
    joints = [rj.Revolute(ends(links[0])[0], rj.ground.at())]
    joints += [rj.Revolute(ends(links[i + 1])[0], ends(links[i])[1]) for i in range(2)]
    joints.append(rj.Revolute(ends(links[2])[1], rj.ground.at(SPAN)))
    return rj.Scene(links, joints, [rj.Gravity()])


def chain_right() -> np.ndarray:
    """One horizontal force, and a vertical one that grows by a weight from bar to bar."""

    def apart(x):
        slopes = x[0] + x[1] * np.arange(3)
        angles = np.arctan(slopes)
        return [np.sum(np.cos(angles)) - SPAN[0], np.sum(np.sin(angles)) - SPAN[1]]

    x = scipy.optimize.fsolve(apart, [-0.8, 0.8], xtol=1e-15)
    return np.arctan(x[0] + x[1] * np.arange(3))


def chain_again() -> np.ndarray:
    def angles(first):
        rest = SPAN - [np.cos(first), np.sin(first)]
        middle, open_ = np.arctan2(rest[1], rest[0]), np.arccos(np.hypot(*rest) / 2)
        return np.array([first, middle - open_, middle + open_])

    def energy(first):
        s = np.sin(angles(first))
        return s[0] / 2 + (s[0] + s[1] / 2) + (s[0] + s[1] + s[2] / 2)

    return angles(least(energy, -0.95, -0.45))


def pushed_bob() -> rj.Scene:
    """A bob of 2 kg on a ball joint, pushed aside by 7 N."""
    body = spatial.RigidBody("bob", 2.0, (0.01, 0.02, 0.02), (0.0, 0.0, -1.0))
    hinge = spatial.Spherical(body.at((0.0, 0.0, 1.0)), rj.ground.at((0.0, 0.0, 0.0)))
    push = rj.Force(body.at(), (1.0, 0.0, 0.0), rj.Constant(7.0))
    return rj.Scene([body], [hinge], [rj.Gravity((0.0, 0.0, -G)), push])


def hinged_bar(push=200.0, stiffness=50.0, length=1.0) -> rj.Scene:
    """A bar on a hinge about y with a torsion spring, pushed down at its end."""
    y = (0.0, 1.0, 0.0)
    body = spatial.RigidBody("bar", 1.0, (0.01, 0.02, 0.02), (0.5 * length, 0.0, 0.0))
    hinge = body.at((-0.5 * length, 0.0, 0.0), axis=y), rj.ground.at((0.0, 0.0, 0.0), axis=y)
    load = rj.Force(body.at((0.5 * length, 0.0, 0.0)), (0.0, 0.0, -1.0), rj.Constant(push))
    spring = rj.TorsionSpring(*hinge, stiffness=stiffness)
    return rj.Scene([body], [spatial.Revolute(*hinge)], [spring, load])


def hinged_bar_found() -> list[float]:
    q = np.asarray(rj.equilibrium(rj.assemble(hinged_bar())))
    return [2 * np.arctan2(q[5], q[3])]


def cantilever(force=1e-5, moment=0.0, count=4, modes=2, **options) -> rj.Scene:
    """So many beams welded end to end along x, with a force across the tip and a moment there."""
    size, mass = LENGTH / count, MASS / count
    beams = [
        rj.Beam(
            f"beam{i}", mass, size, EI=EI, modes=modes, position=((i + 0.5) * size, 0.0), **options
        )
        for i in range(count)
    ]
    at = [rj.ground.at(), *(beam.at("end") for beam in beams)]
    welds = [rj.Weld(beam.at("start"), end) for beam, end in zip(beams, at, strict=False)]
    push = rj.Force(at[-1], (0.0, 1.0), rj.Constant(force))
    return rj.Scene(beams, welds, [push, rj.Torque(at[-1], rj.Constant(moment))])


def cantilever_found() -> list[float]:
    """Deflections and slopes of the tip per unit of a small force, and of a small moment."""
    values = []
    small = 1e-5
    for loads in ((small, 0.0), (0.0, small)):
        scene = cantilever(*loads)
        system = rj.assemble(scene)
        tip = rj.measure(system, rj.equilibrium(system), scene.bodies[-1].at("end"))
        values += [float(tip.position[1]) / small, float(tip.angle) / small]
    return values


def cantilever_again() -> np.ndarray:
    """∫ M M̄ / EI by Gauss's rule, with the moments M̄ of unit loads (Castigliano)."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    s, weights = LENGTH * (nodes + 1) / 2, weights * LENGTH / 2
    moments = np.stack([LENGTH - s, np.ones_like(s)])
    return (moments * weights @ moments.T / EI).ravel()


PROBLEMS = (
    Problem(
        "truss that snaps through",
        "Two springs of 1000 N/m hold a mass 0.4 m above their ends. Its height under 15 N,\n"
        "before it snaps through, and under 40 N, which it finds from the same start.",
        "closed form (von Mises truss)",
        lambda: named("height (15 N) [m], height (40 N) [m]", truss_right()),
        (MOMENTS, ENERGY),
        lambda: [rj.equilibrium(rj.assemble(truss(load)))[1] for load in (15.0, 40.0)],
        truss_again,
        scene=truss,
    ),
    Problem(
        "hanging chain",
        "Three uniform bars of 1 m hang between two points 2.4 m apart, one 0.1 m higher.\n"
        "Their angles, from a start out of balance.",
        "closed form",
        lambda: named("first [rad], second [rad], third [rad]", chain_right()),
        (MOMENTS, ENERGY),
        lambda: np.asarray(rj.equilibrium(rj.assemble(hanging_chain())))[2::3],
        chain_again,
        scene=hanging_chain,
    ),
    Problem(
        "bob that is pushed",
        "A bob of 2 kg on a ball joint of 1 m is pushed aside by 7 N, in space.\n"
        "Its place, whatever the length of its quaternion.",
        "closed form",
        lambda: named("x [m], z [m]", np.array([7.0, -2 * G]) / np.hypot(7.0, 2 * G)),
        (MOMENTS, ENERGY),
        lambda: np.asarray(rj.equilibrium(rj.assemble(pushed_bob())))[[0, 2]],
        lambda: (lambda x: [np.sin(x), -np.cos(x)])(
            least(lambda x: -7.0 * np.sin(x) - 2 * G * np.cos(x), 0.0, 1.5)
        ),
        scene=pushed_bob,
    ),
    Problem(
        "bar on a torsion spring",
        "A bar of 1 m on a hinge in space with 50 N m/rad, pushed down at its end by 200 N:\n"
        "k φ = F l cos φ.",
        "closed form",
        lambda: named(
            "angle [rad]",
            [scipy.optimize.brentq(lambda x: 50 * x - 200 * np.cos(x), 0, 1.5, xtol=1e-15)],
        ),
        (MOMENTS, ENERGY),
        hinged_bar_found,
        lambda: [least(lambda x: 25.0 * x**2 - 200.0 * np.sin(x), 0.0, 1.5)],
        scene=hinged_bar,
    ),
    Problem(
        "cantilever of welded beams",
        "Four beams of two modes, welded to one cantilever of 1.3 m and 3 N m². Deflection and\n"
        "slope of the tip by a force across it, and by a moment: L³/3EI, L²/2EI, L²/2EI, L/EI.",
        "closed form (Euler and Bernoulli)",
        lambda: named(
            "deflection by force [m/N], slope by force [1/N], "
            "deflection by moment [1/N], slope by moment [1/(N m)]",
            np.array([LENGTH**3 / 3, LENGTH**2 / 2, LENGTH**2 / 2, LENGTH]) / EI,
        ),
        ("closed form", "Castigliano's integrals by Gauss's rule"),
        cantilever_found,
        cantilever_again,
        scene=cantilever,
    ),
)
