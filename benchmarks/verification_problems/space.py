"""Rigid bodies in space, in motion."""

import numpy as np
import scipy.special

import romjax as rj
from romjax import spatial
from romjax.linalg import quaternions

from .points import IFTOMM, SCIPY
from .problem import G, Problem, integrated, named, run

TWICE = "two integrations in 40 digits"
ARM, HEAVY = 1.0, 15.0
TENSOR = np.array([0.234375, 0.46875, 0.234375])
TOP = (0.17334396409838604259, 0.64008859207056878286, -0.74849079113358130948)
# A free body with J = (1, 2, 3) and ω₀ = (0.001, 5, 0.02).
MOMENTS, RATES = np.array([1.0, 2.0, 3.0]), np.array([0.001, 5.0, 0.02])
FLIPPED = -0.5185973279749573682
STEEP = np.pi / 3  # of the steady precession, against the vertical


def top(place=(0.0, 1.0, 0.0), turn=None, world=(0.0, 150.0, -4.61538)) -> rj.Scene:
    """The heavy top of 15 kg, whose axis is the second of its own, on a ball joint at the origin:
    its place, the matrix that turns it, and its angular velocity by axes that stand.
    """
    body = spatial.RigidBody(
        "top",
        HEAVY,
        tuple(TENSOR),
        position=place,
        orientation=np.eye(3) if turn is None else turn,
        velocity=tuple(np.cross(world, place)),
        angular_velocity=world,
    )
    pivot = spatial.Spherical(body.at((0.0, -ARM, 0.0)), rj.ground.at((0.0, 0.0, 0.0)))
    return rj.Scene([body], [pivot], [rj.Gravity((0.0, 0.0, -G))])


def top_found(scene, end=1.0) -> np.ndarray:
    return np.asarray(run(rj.assemble(scene), 0.0, end).q)[-1, :3]


def top_again() -> np.ndarray:
    """Euler's equations about the pivot, with a rotation matrix."""
    about = TENSOR + HEAVY * np.array([1.0, 0.0, 1.0])

    def slope(_, y):
        turn, omega = y[:9].reshape(3, 3), y[9:]
        x, y_, z = omega
        cross = np.array([[0, -z, y_], [z, 0, -x], [-y_, x, 0]])
        weight = np.cross([0.0, ARM, 0.0], turn.T @ [0.0, 0.0, -HEAVY * G])
        return [*(turn @ cross).ravel(), *((weight - np.cross(omega, about * omega)) / about)]

    end = integrated(slope, [*np.eye(3).ravel(), 0.0, 150.0, -4.61538], 0.0, 1.0)[-1]
    return end[:9].reshape(3, 3)[:, 1]


def precession() -> float:
    """The slow root of A cos θ Ω² − C ω Ω + m g l = 0."""
    across, along = TENSOR[0] + HEAVY, TENSOR[1]
    return np.min(np.roots([across * np.cos(STEEP), -along * 150.0, HEAVY * G * ARM]))


def precessing() -> rj.Scene:
    """The top at 60° against the vertical, spinning by 150 rad/s, in steady precession."""
    axis = np.array([np.sin(STEEP), 0.0, np.cos(STEEP)])
    other = np.array([0.0, 1.0, 0.0])
    matrix = np.stack([np.cross(axis, other), axis, other], axis=1)
    omega = precession() * np.array([0.0, 0.0, 1.0])
    omega = omega + (150.0 - omega @ axis) * axis
    return top(tuple(axis), matrix, tuple(omega))


def nut() -> rj.Scene:
    body = spatial.RigidBody("nut", 1.0, tuple(MOMENTS), angular_velocity=tuple(RATES))
    return rj.Scene([body])


def nut_found() -> list[float]:
    made = run(rj.assemble(nut()), 0.0, 10.0, atol=1e-14)
    return [float(quaternions.body_angular_velocity(made.q[-1, 3:], made.v[-1, 3:])[0])]


def nut_again() -> list[float]:
    def slope(_, w):
        return -np.cross(w, MOMENTS * w) / MOMENTS

    return [integrated(slope, RATES, 0.0, 10.0)[-1, 0]]


def half_period() -> float:
    """Of the rates of the free body, by a complete elliptic integral."""
    (a, b, c), energy = MOMENTS, np.sum(MOMENTS * RATES**2)
    spare = np.sum((MOMENTS * RATES) ** 2) - energy * MOMENTS
    speed = np.sqrt((c - b) * spare[0] / (a * b * c))
    return 2 * scipy.special.ellipk(-(b - a) * spare[2] / ((c - b) * spare[0])) / speed


def spin_of(system, t, q, v):
    return quaternions.body_angular_velocity(q[3:], v[3:])[1]


def period_found() -> list[float]:
    made = run(rj.assemble(nut()), 0.0, 8.0, atol=1e-14, events=[rj.Crossing(spin_of)])
    first, second = made.events.times()[:2]
    return [second - first]


def crank_found() -> list[float]:
    made = run(rj.assemble(rj.gallery.spatial_slider_crank()), *np.linspace(0.0, 1.0, 41))
    angle = 2 * np.unwrap(np.arctan2(made["crank.p1"], made["crank.p0"]), period=np.pi)
    return [angle[-1] - angle[0], np.asarray(made["slider.x"])[-1]]


def bricard_found() -> np.ndarray:
    scene = rj.gallery.bricard()
    system = rj.assemble(scene)
    made = rj.simulate(system, np.array([0.0, 1.0]), rtol=1e-10)
    return np.asarray(rj.measure(system, made, scene.bodies[2].at("end")).position)[-1]


PROBLEMS = (
    Problem(
        "heavy top",
        "A top of 15 kg on a ball joint spins by 150 rad/s. The place of its centre of mass\n"
        "after a second.",
        "Brüls, Cardona and Arnold 2012, doi:10.1016/j.mechmachtheory.2011.07.017",
        lambda: named("x [m], y [m], z [m]", TOP),
        (TWICE, SCIPY.format("Euler's equations about the pivot")),
        lambda: top_found(top()),
        top_again,
        scene=top,
    ),
    Problem(
        "steady precession",
        "The same top at 60° against the vertical, started in its slow steady precession:\n"
        "A cos θ Ω² − C ω Ω + m g l = 0. Where its centre of mass is after a second.",
        "closed form",
        lambda: named(
            "x [m], y [m], z [m]",
            [
                np.sin(STEEP) * np.cos(precession()),
                np.sin(STEEP) * np.sin(precession()),
                np.cos(STEEP),
            ],
        ),
        ("closed form", "the rate in 20 digits of another code, 3.2069737017038288536 rad/s"),
        lambda: top_found(precessing()),
        lambda: [
            np.sin(STEEP) * np.cos(3.2069737017038288536),
            np.sin(STEEP) * np.sin(3.2069737017038288536),
            np.cos(STEEP),
        ],
        scale=1.0,
        scene=precessing,
    ),
    Problem(
        "free body",
        "A free body with moments of inertia 1, 2 and 3 kg m² turns about its middle axis,\n"
        "which is unstable. Its rate about the first axis after 10 s.",
        "closed form (Euler, Jacobi)",
        lambda: named("rate [rad/s]", [FLIPPED]),
        ("Jacobi's elliptic functions, 20 digits", SCIPY.format("Euler's equations")),
        nut_found,
        nut_again,
        scene=nut,
    ),
    Problem(
        "period of a free body",
        "The time between two passages of the spin of that body through zero, as events.",
        "closed form (Euler, Jacobi)",
        lambda: named("half of a period [s]", [half_period()]),
        ("a complete elliptic integral", "half of 8.8110139803351158253 s, of another code"),
        period_found,
        lambda: [8.8110139803351158253 / 2],
        scene=nut,
    ),
    Problem(
        "slider crank in space",
        "A crank, a rod on a ball and a universal joint, and a slider, in space.\n"
        "The turn of the crank and the place of the slider after a second.",
        "Haug 1989, pages 396 to 401",
        lambda: named("crank [rad], slider [m]", [10.913590729864667999, 0.211721661393443778]),
        (TWICE, "the published rates of the start"),
        crank_found,
        scene=rj.gallery.spatial_slider_crank,
    ),
    Problem(
        "Bricard's loop",
        "Five rods along edges of a cube on six hinges: one row of thirty repeats the others\n"
        "all along. The fourth corner after a second.",
        IFTOMM.format("problem A04; González, Dopico, Lugrís and Cuadrado 2006"),
        lambda: named("x [m], y [m], z [m]", [0.5105, -1.6492, 0.1401]),
        ("the published value, four digits", "the library's other codes"),
        bricard_found,
        scale=1.0,
        scene=rj.gallery.bricard,
    ),
)
