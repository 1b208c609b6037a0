"""When something happens: impacts, passages, contact and friction."""

import itertools

import numpy as np
import scipy.optimize
import scipy.special

import romjax as rj

from .plane import bar, ends
from .points import SCIPY
from .problem import G, Problem, integrated, named, run

MASS, HEIGHT, STIFFNESS = 0.4, 1.0, 2e5
BALLS, RADIUS, LENGTH, BALL, ASIDE = 6, 0.05, 0.5, 0.3, 0.6


def falling() -> rj.Scene:
    ball = rj.RigidBody("ball", 1.3, 0.1, position=(0.0, HEIGHT))
    return rj.Scene([ball], [], [rj.Gravity()])


def travel(marker, height=0.0) -> rj.quantity.Travel:
    return rj.quantity.Travel(marker, rj.ground.at((0.0, height), angle=np.pi / 2))


def bounces() -> np.ndarray:
    """Times of six impacts, the speed after the last, and the height at 3 s."""
    speed, times = np.sqrt(2 * G * HEIGHT), [np.sqrt(2 * HEIGHT / G)]
    for k in range(1, 6):
        times.append(times[-1] + 2 * speed * 0.8**k / G)
    left = 3.0 - times[-1]
    return np.array([times[0], times[-1], speed * 0.8**6 * left - G * left**2 / 2])


def bounces_found() -> np.ndarray:
    scene = falling()
    impact = rj.Impact(travel(scene.bodies[0].at()), restitution=0.8)
    made = run(rj.assemble(scene), 0.0, 3.0, events=[impact])
    times = made.events.times()
    return np.array([times[0], times[-1], made.q[-1, 1]])


def bounces_again() -> np.ndarray:
    """By halving each height, h e², and adding the times of falling and rising."""
    heights = HEIGHT * 0.8 ** (2 * np.arange(7))
    times = np.sqrt(2 * heights / G)
    last = times[0] + 2 * np.sum(times[1:6])
    left = 3.0 - last - times[6]
    return np.array([times[0], last, heights[6] - G * left**2 / 2])


def rod() -> rj.Scene:
    return rj.Scene([rj.RigidBody("rod", 0.8, 0.03, position=(0.0, 0.5))], [], [rj.Gravity()])


def rod_right() -> np.ndarray:
    """P = (1 + e) u m / (1 + m l²/4I) at the end that hits."""
    speed = np.sqrt(2 * G * 0.5)
    impulse = 1.7 * speed * 0.8 / (1 + 0.8 * 0.6**2 / (4 * 0.03))
    return np.array([speed / G, impulse, -speed + impulse / 0.8, impulse * 0.3 / 0.03])


def rod_again() -> np.ndarray:
    """Two equations of momentum and Newton's law of restitution, as a linear system."""
    speed = np.sqrt(2 * G * 0.5)
    # Unknown: impulse, velocity, rate.
    matrix = np.array([[-1, 0.8, 0], [-0.3, 0, 0.03], [0, 1, 0.3]])
    return np.array([speed / G, *np.linalg.solve(matrix, [-0.8 * speed, 0, 0.7 * speed])])


def rod_found() -> np.ndarray:
    scene = rod()
    impact = rj.Impact(travel(scene.bodies[0].at((0.3, 0.0))), restitution=0.7)
    events = run(rj.assemble(scene), 0.0, 0.33, events=[impact]).events
    return np.array([events.times()[0], events.impulse[0, 0], *events.v_after[0, 1:]])


def cradle() -> rj.Scene:
    """Newton's cradle of six balls, the first pulled aside."""
    balls, hinges = [], []
    for i in range(BALLS):
        angle = -ASIDE if i == 0 else 0.0
        hinge = np.array([2 * RADIUS * i, 0.0])
        place = hinge + LENGTH * np.array([np.sin(angle), -np.cos(angle)])
        inertia = 0.4 * BALL * RADIUS**2
        balls.append(rj.RigidBody(f"ball {i}", BALL, inertia, position=place, angle=angle))
        hinges.append(rj.Revolute(balls[i].at((0.0, LENGTH)), rj.ground.at(hinge)))
    return rj.Scene(balls, hinges, [rj.Gravity()])


def knocks(scene: rj.Scene) -> list[rj.Impact]:
    """The impacts of each ball with the next."""
    gaps = [rj.quantity.Gap(a.at(), b.at()) for a, b in itertools.pairwise(scene.bodies)]
    return [rj.Impact(gap, level=2 * RADIUS) for gap in gaps]


def cradle_found() -> list[float]:
    scene = cradle()
    made = run(
        rj.assemble(scene),
        *np.linspace(0.0, 1.0, 21),
        events=knocks(scene),
        stabilization=rj.Projection(),
    )
    return [made.events.times()[0], abs(float(made.events.v_after[0, 3 * BALLS - 1]))]


def cradle_right() -> list[float]:
    inertia = BALL * LENGTH**2 + 0.4 * BALL * RADIUS**2
    speed = np.sqrt(2 * BALL * G * LENGTH * (1 - np.cos(ASIDE)) / inertia)
    pull = np.sqrt(BALL * G * LENGTH / inertia)
    return [scipy.special.ellipk(np.sin(ASIDE / 2) ** 2) / pull, speed]


def cradle_again() -> list[float]:
    pull = BALL * G * LENGTH / (BALL * LENGTH**2 + 0.4 * BALL * RADIUS**2)

    def end(t):
        return integrated(lambda _, y: [y[1], -pull * np.sin(y[0])], [ASIDE, 0.0], 0.0, t)[-1]

    time = scipy.optimize.brentq(lambda t: end(t)[0], 0.3, 0.5, xtol=1e-13)
    return [time, abs(end(time)[1])]


def swinging() -> rj.Scene:
    link = bar("bar", (0, 0), (1, 0), 1.0)
    return rj.Scene([link], [rj.Revolute(ends(link)[0], rj.ground.at())], [rj.Gravity()])


def angle_of(system, t, q, v):
    return q[2]


def swinging_found() -> list[float]:
    scene = swinging()
    lowest = rj.Crossing(angle_of, level=-np.pi / 2)
    made = run(rj.assemble(scene), 0.0, 1.0, events=[lowest])
    return [made.events.times()[0]]


def swinging_again() -> list[float]:
    def angle(t):
        return integrated(lambda _, y: [y[1], -1.5 * G * np.cos(y[0])], [0.0, 0.0], 0.0, t)[-1, 0]

    return [scipy.optimize.brentq(lambda t: angle(t) + np.pi / 2, 0.3, 0.8, xtol=1e-14)]


def striking(loss=0.3) -> rj.Scene:
    body = rj.RigidBody("ball", MASS, 0.01, position=(0.0, 0.05), velocity=(0.0, -1.0))
    touch = rj.Contact(body.at(), rj.ground.at(), rj.Line(), stiffness=STIFFNESS, dissipation=loss)
    return rj.Scene([body], [], [touch])


def struck(loss=0.3) -> float:
    """By the integral of v / (1 + D v), whatever mass, stiffness and exponent are."""

    def integral(v):
        return v / loss - np.log1p(loss * v) / loss**2

    return scipy.optimize.brentq(lambda v: integral(1.0) - integral(-v), 0.1, 1.0, xtol=1e-15)


def struck_again(loss=0.3) -> list[float]:
    def slope(_, y):
        depth = max(y[0], 0.0)
        return [y[1], -STIFFNESS / MASS * depth**1.5 * (1 + loss * y[1])]

    return [-integrated(slope, [0.0, 1.0], 0.0, 0.02)[-1, 1]]


def racket() -> rj.Scene:
    """A ball that rests before a racket which moves by 1.5 m/s, as prescribed."""
    body = rj.RigidBody("racket", 1.0, 1.0, velocity=(1.5, 0.0))
    ball = rj.RigidBody("ball", 0.2, 1e-4, position=(1.0, 0.0))
    joints = [
        rj.FixedAngle(body.at(), rj.ground.at()),
        rj.PointOnLine(body.at(), rj.ground.at()),
        rj.PrescribedTravel(body.at(), rj.ground.at(), rj.Ramp(1.5)),
    ]
    return rj.Scene([body, ball], joints)


def racket_found() -> list[float]:
    scene = racket()
    body, ball = scene.bodies
    impact = rj.Impact(rj.quantity.Travel(ball.at(), body.at()), restitution=0.5)
    made = run(rj.assemble(scene), 0.0, 1.0, events=[impact])
    return [made.events.times()[0], np.asarray(made["ball.x'"])[-1]]


PROBLEMS = (
    Problem(
        "bouncing ball",
        "A ball falls by 1 m and bounces with a restitution of 0.8. The times of the first and\n"
        "the sixth impact, and its height at 3 s.",
        "closed form",
        lambda: named("first impact [s], sixth impact [s], height (3 s) [m]", bounces()),
        ("speeds after the impacts", "heights of the flights"),
        bounces_found,
        bounces_again,
        scene=falling,
    ),
    Problem(
        "rod that falls on its end",
        "A level rod falls by 0.5 m; one end hits the floor with a restitution of 0.7. Time,\n"
        "impulse, velocity and rate after it.",
        "closed form",
        lambda: named("time [s], impulse [N s], velocity [m/s], rate [rad/s]", rod_right()),
        ("effective mass of the end", "momenta and restitution as a linear system"),
        rod_found,
        rod_again,
        scene=rod,
    ),
    Problem(
        "Newton's cradle",
        "Six balls that touch, the first let go at 0.6 rad. When it hits, and the rate with which\n"
        "the last leaves: that of the first, through four that stay at rest.",
        "closed form",
        lambda: named("time [s], rate [rad/s]", cradle_right()),
        ("an elliptic integral; balance of energy", SCIPY.format("one angle")),
        cradle_found,
        cradle_again,
        scene=cradle,
    ),
    Problem(
        "passage through the lowest point",
        "A uniform bar of 1 m, released from the level: when it passes the vertical, found\n"
        "between the outputs.",
        "closed form",
        lambda: named("time [s]", [scipy.special.ellipk(0.5) / np.sqrt(1.5 * G)]),
        ("a complete elliptic integral", SCIPY.format("one angle")),
        swinging_found,
        swinging_again,
        scene=swinging,
    ),
    Problem(
        "restitution of a contact",
        "A ball of 0.4 kg strikes a floor by 1 m/s, with the contact's force k δ^1.5 (1 + D δ').\n"
        "The speed with which it leaves depends on D alone.",
        "after Hunt and Crossley 1975",
        lambda: named("speed [m/s]", [struck()]),
        ("a first integral", SCIPY.format("of the depth")),
        lambda: [run(rj.assemble(striking()), 0.0, 0.15, rtol=1e-11).v[-1, 1]],
        struck_again,
        scene=striking,
    ),
    Problem(
        "ball before a racket",
        "A racket that is moved by 1.5 m/s meets a ball at rest, with a restitution of 0.5.\n"
        "When, and how fast the ball leaves.",
        "closed form",
        lambda: named("time [s], speed [m/s]", [1.0 / 1.5, 2.25]),
        (
            "restitution in the frame of the racket",
            "twice the racket's speed, less half of it lost",
        ),
        racket_found,
        scene=racket,
    ),
)
