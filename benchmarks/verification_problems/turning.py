"""Blades and shafts that turn, and beams in space that bend far."""

import numpy as np
import scipy.integrate
import scipy.linalg
import scipy.optimize

import romjax as rj
from romjax import spatial

from .columns import trial
from .problem import Problem, named

LENGTH, MASS, EI, POLAR = 1.3, 0.7, 3.0, 1e-5
UNIT = np.sqrt(EI / (MASS * LENGTH**3))  # of frequencies and speeds
ORIGIN, Z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
HUB = 1e6  # [kg m²], beside which a blade is nothing
# The Princeton beam (Dowell and Traybar 1975): aluminium, on edge, with a load at its tip.
PRINCETON = {"modulus": 71.7e9, "shear_modulus": 71.7e9 / 2.62, "density": 2700.0}
SPAN, WIDE, HIGH, POUND = 0.508, 3.175e-3, 12.7e-3, 4.448222
# Two pounds at 45 degrees.
LOAD = 2 * POUND * np.array([0.0, 1.0, 1.0]) / np.sqrt(2)


def stiffened(tension, speed, terms=9):
    """Lowest frequency of a clamped beam that turns or is pulled, by Ritz with polynomials.

    In units of √(EI / m L³), m L³ Ω² / EI and EI / L².
    """
    _, matrix = trial(terms)
    pull = np.polynomial.Polynomial([tension + speed**2 / 2, 0, -(speed**2) / 2])
    stiffness = matrix(2) + matrix(1, pull) - speed**2 * matrix(0)
    return np.sqrt(scipy.linalg.eigh(stiffness, matrix(0))[0][0])


def blade() -> rj.Scene:
    """A stiffened blade in space, welded to a hub on a bearing about z."""
    hub = spatial.RigidBody("hub", 1.0, (HUB, HUB, HUB))
    across = MASS * LENGTH**2 / 12 + POLAR / 2
    arm = spatial.Beam(
        "blade",
        MASS,
        LENGTH,
        (POLAR, across, across),
        EI=EI,
        bending=6,
        stiffening=True,
        position=(LENGTH / 2, 0.0, 0.0),
    )
    joints = [
        spatial.Revolute(hub.at(axis=Z), rj.ground.at(ORIGIN, axis=Z)),
        spatial.Weld(arm.at("start"), hub.at()),
    ]
    return rj.Scene([hub, arm], joints)


def flat_blade() -> rj.Scene:
    hub = rj.RigidBody("hub", 1.0, HUB)
    arm = rj.Beam("blade", MASS, LENGTH, EI=EI, modes=8, stiffening=True, position=(LENGTH / 2, 0))
    joints = [
        rj.Revolute(hub.at(), rj.ground.at()),
        rj.Weld(arm.at("start"), hub.at()),
    ]
    return rj.Scene([hub, arm], joints)


def lowest(scene, speed: float, count: int) -> np.ndarray:
    """Of the small motions of what turns steadily, in units."""
    found = rj.modes(rj.assemble(scene), turning=speed * UNIT).frequencies
    return np.asarray([x for x in found / UNIT if x > 1e-2][:count])


def flapping() -> list[float]:
    return [float(np.hypot(stiffened(0.0, speed), speed)) for speed in (1.0, 2.0)]


def flap_found() -> list[float]:
    """Beside lead-lag, whose frequency is lower."""
    return [float(lowest(blade(), speed, 2)[1]) for speed in (1.0, 2.0)]


def stiffnesses() -> np.ndarray:
    shear, modulus = PRINCETON["shear_modulus"], PRINCETON["modulus"]
    edge = rj.sections.Rectangle(WIDE, HIGH)
    sections = edge.torsion_constant, edge.second_moment_y, edge.second_moment
    return np.array([shear * sections[0], modulus * sections[1], modulus * sections[2]])


def twist(turn: np.ndarray) -> float:
    """About x, twice the angle by which a quaternion has it."""
    return 2 * np.arctan2(turn[2, 1] - turn[1, 2], 1 + np.trace(turn))


def geometrically_exact(force):
    """Displacement of the tip and rotation about the axis of a clamped Kirchhoff rod, by shooting
    for its root moment: r' = d, R' = R κ̃, m' = −d × F, R diag(GJ, EI_y, EI_z) κ = m.
    """
    stiffness = stiffnesses()

    def slope(_, y):
        turn, moment = y[3:12].reshape(3, 3), y[12:]
        x, y, z = (turn.T @ moment) / stiffness
        curved = turn @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.concatenate([turn[:, 0], curved.ravel(), -np.cross(turn[:, 0], force)])

    def tip(root):
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), root])
        run = scipy.integrate.solve_ivp(slope, (0, SPAN), start, "DOP853", rtol=1e-11, atol=1e-13)
        return run.y[:, -1]

    lever = np.array([0.0, -force[2], force[1]]) * SPAN
    end = tip(scipy.optimize.fsolve(lambda root: tip(root)[12:], 0.97 * lever, xtol=1e-11))
    turn = end[3:12].reshape(3, 3)
    return np.array([end[0] - SPAN, end[1], end[2], twist(turn)])


def collocated(force=LOAD) -> np.ndarray:
    """The same boundary-value problem by collocation, with quaternions."""
    stiffness = stiffnesses()

    def matrix(p):
        w, x, y, z = p
        return np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )

    def slope(_, states):
        out = np.empty_like(states)
        for i, y in enumerate(states.T):
            turn, p = matrix(y[3:7]), y[3:7]
            kx, ky, kz = (turn.T @ y[7:]) / stiffness
            rate = [
                -p[1] * kx - p[2] * ky - p[3] * kz,
                p[0] * kx + p[2] * kz - p[3] * ky,
                p[0] * ky - p[1] * kz + p[3] * kx,
                p[0] * kz + p[1] * ky - p[2] * kx,
            ]
            moment = -np.cross(turn[:, 0], force)
            out[:, i] = [*turn[:, 0], *(0.5 * np.array(rate)), *moment]
        return out

    def ends(a, b):
        return np.concatenate([a[:3], a[3:7] - [1, 0, 0, 0], b[7:]])

    s = np.linspace(0, SPAN, 41)
    guess = np.zeros((10, len(s)))
    guess[0], guess[3] = s, 1.0
    made = scipy.integrate.solve_bvp(slope, ends, s, guess, tol=1e-9, max_nodes=20000)
    x, y, z, *p = made.y[:7, -1]
    turn = matrix(np.array(p))
    return np.array([x - SPAN, y, z, twist(turn)])


def princeton(count=8, force=LOAD) -> rj.Scene:
    """The beam as so many that are welded end to end."""
    size = SPAN / count
    bodies = [
        spatial.Beam.of_section(
            f"beam {k}",
            size,
            rj.sections.Rectangle(WIDE, HIGH),
            **PRINCETON,
            bending=2,
            torsion=1,
            stiffening=True,
            position=((k + 0.5) * size, 0.0, 0.0),
        )
        for k in range(count)
    ]
    ends = [rj.ground.at(ORIGIN), *(body.at("end") for body in bodies)]
    joints = [spatial.Weld(b.at("start"), end) for b, end in zip(bodies, ends[:-1], strict=True)]
    load = rj.Force(bodies[-1].at("end"), force, rj.Constant(np.linalg.norm(force)))
    return rj.Scene(bodies, joints, [load])


def bent(count=8, force=LOAD) -> np.ndarray:
    """Displacement of the tip and its turn about the axis, in equilibrium."""
    scene = princeton(count, force)
    system = rj.assemble(scene)
    tip = rj.measure(system, rj.equilibrium(system), scene.bodies[-1].at("end"))
    return np.array([*(np.asarray(tip.position) - [SPAN, 0, 0]), twist(np.asarray(tip.rotation))])


PROBLEMS = (
    Problem(
        "flap of a rotating blade",
        "A clamped blade that turns by 1 and 2 √(EI/mL³), with stiffening: the frequency of\n"
        "flapping in that unit.",
        "Wright, Smith, Thresher and Wang 1982",
        lambda: named("slow, fast", flapping()),
        ("Ritz's method with polynomials", "the published table, five digits"),
        flap_found,
        lambda: [3.6816, 4.1373],
        scene=blade,
    ),
    Problem(
        "lead-lag in the plane",
        "The same in the plane of rotation at 6 √(EI/mL³), where the frequency is\n√(flap² − Ω²).",
        "closed form of Wright, Smith, Thresher and Wang 1982",
        lambda: named("frequency", [stiffened(0.0, 6.0)]),
        ("Ritz's method with 9 polynomials", "Ritz's method with 7 polynomials"),
        lambda: lowest(flat_blade(), 6.0, 1),
        lambda: [stiffened(0.0, 6.0, 7)],
        scene=flat_blade,
    ),
    Problem(
        "Princeton beam",
        "An aluminium strip of 508 mm on edge, with two pounds at its tip at 45 degrees: tip and\n"
        "twist of eight beams that are welded, a tenth of the span aside.",
        "Dowell and Traybar 1975",
        lambda: named("x [m], y [m], z [m], twist [rad]", geometrically_exact(LOAD)),
        ("shooting for the moment of the root", "collocation with quaternions, by SciPy"),
        bent,
        collocated,
        scene=princeton,
    ),
)
