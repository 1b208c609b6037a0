"""Rigid mechanisms in the plane, in motion."""

import jax.numpy as jnp
import numpy as np

import romjax as rj

from .points import IFTOMM, SCIPY
from .problem import G, Problem, integrated, named, run


def slider_pendulum() -> rj.Scene:
    """Cart of 1 kg on the x axis with a spring to the origin, and a pendulum of 1 kg and 1 kg m²
    hinged to it at half its length of 1 m, released from the horizontal; gravity 10 m/s².
    """
    slider = rj.RigidBody("slider", mass=1.0, inertia=1.0)
    pendulum = rj.RigidBody("pendulum", mass=1.0, inertia=1.0, position=(0.5, 0.0))
    joints = [
        rj.PointOnLine(slider.at(), rj.ground.at()),
        rj.FixedAngle(slider.at(), rj.ground.at()),
        rj.Revolute(slider.at(), pendulum.at((-0.5, 0.0))),
    ]
    spring = rj.Spring(slider.at(), rj.ground.at(), stiffness=10.0)
    return rj.Scene([slider, pendulum], joints, [spring, rj.Gravity((0.0, -10.0))])


def slider_pendulum_again(_, y):
    x, angle, u, w = y
    s, c = np.sin(angle), np.cos(angle)
    mass = np.array([[2.0, -s / 2], [-s / 2, 1.25]])
    return [u, w, *np.linalg.solve(mass, [c * w**2 / 2 - 10 * x, -5 * c])]


def cart_found() -> np.ndarray:
    made = run(rj.assemble(slider_pendulum()), 0.0, 5.0)
    q, v = np.asarray(made.q)[-1], np.asarray(made.v)[-1]
    return np.array([q[0], q[5], v[0], v[5]])


def sprung_crank() -> rj.Scene:
    """SUNDIALS' slider crank: a crank of 0.5 m and 1 kg m², a rod of 1 m and 2 kg m² whose mass of
    1 kg sits at the slider, a spring and a damper between their middles, a force of 1 N.
    """
    angle = -np.pi / 6
    x = np.cos(angle)
    crank = rj.RigidBody("crank", mass=1.0, inertia=1.0, angle=np.pi / 2)
    rod = rj.RigidBody("rod", mass=1.0, inertia=2.0, position=(x, 0.0), angle=angle)
    middles = crank.at((0.25, 0.0)), rod.at((-0.5, 0.0))
    joints = [
        rj.Revolute(crank.at(), rj.ground.at()),
        rj.Revolute(crank.at((0.5, 0.0)), rod.at((-1.0, 0.0))),
        rj.PointOnLine(rod.at(), rj.ground.at()),
    ]
    effects = [
        rj.Spring(*middles, stiffness=1.0, rest_length=1.0),
        rj.Damper(*middles, damping=1.0, along_line=True),
        # The published force does work along x + cos p: at the far end of twice the rod.
        rj.Force(rod.at((1.0, 0.0)), (1.0, 0.0), rj.Constant(1.0)),
    ]
    return rj.Scene([crank, rod], joints, effects)


def sprung_crank_found() -> np.ndarray:
    slow = rj.Baumgarte.critical(1.0)  # as the mechanism is
    made = run(rj.assemble(sprung_crank()), 0.0, 10.0, stabilization=slow)
    return np.asarray(made.q)[-1, [2, 3, 5]]


def bar(name, start, end, mass) -> rj.RigidBody:
    """A uniform bar between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    (x, y), length = end - start, float(np.hypot(*(end - start)))
    place = {"position": (start + end) / 2, "angle": float(np.arctan2(y, x))}
    return rj.RigidBody(name, mass, mass * length**2 / 12, extent=(length, 0.02), **place)


def ends(body: rj.RigidBody) -> tuple[rj.Marker, rj.Marker]:
    half = body.extent * jnp.array([0.5, 0.0])
    return body.at(-half), body.at(half)


def pushed_crank(torque=0.1) -> rj.Scene:
    """Crank, rod and slider, all along x, with a torque at the crank."""
    crank, rod = bar("crank", (0, 0), (0.1, 0), 0.2), bar("rod", (0.1, 0), (0.4, 0), 0.2)
    slider = rj.RigidBody("slider", 0.4, 0.0004, position=(0.4, 0.0))
    joints = [
        rj.Revolute(ends(crank)[0], rj.ground.at()),
        rj.Revolute(ends(rod)[0], ends(crank)[1]),
        rj.Revolute(ends(rod)[1], slider.at()),
        rj.PointOnLine(slider.at(), rj.ground.at()),
        rj.FixedAngle(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([crank, rod, slider], joints, [rj.Torque(crank.at(), rj.Constant(torque))])


def pushed_crank_found() -> list[float]:
    """At 0.3 s, and at 3 s where the torque ends at 2 s."""
    driven, free = (rj.assemble(pushed_crank(torque)) for torque in (0.1, 0.0))
    settings = {"stabilization": rj.Projection()}
    first = run(driven, 0.0, 0.3, 2.0, **settings)
    then = run(free, 2.0, 3.0, q0=first.q[-1], v0=first.v[-1], **settings)
    return [x for one in (first, then) for x in (one.q[1, 2], one.v[1, 2], one.q[1, 6])]


def pushed_crank_again() -> list[float]:
    """In the crank's angle alone: M φ̈ + M' φ̇² / 2 = τ."""

    def slider(angle):
        return 0.1 * np.cos(angle) + np.sqrt(0.09 - 0.01 * np.sin(angle) ** 2)

    def mass(angle):
        """Of the slopes of all places by the angle, by complex steps."""
        turn = -np.arcsin(np.sin(angle) / 3)
        slope = -np.cos(angle) / 3 / np.cos(turn)
        across = -0.1 * np.sin(angle) - 0.15 * np.sin(turn) * slope
        up = 0.1 * np.cos(angle) + 0.15 * np.cos(turn) * slope
        travel = -0.1 * np.sin(angle) - 0.3 * np.sin(turn) * slope
        rod = 0.2 * (across**2 + up**2) + 0.2 * 0.09 / 12 * slope**2
        return 0.2 * 0.01 / 3 + rod + 0.4 * travel**2

    def slope(torque):
        def of(_, y):
            by_angle = np.imag(mass(y[0] + 1e-30j)) / 1e-30
            return [y[1], (torque - 0.5 * by_angle * y[1] ** 2) / mass(y[0])]

        return of

    first = integrated(slope(0.1), [0.0, 0.0], 0.0, 0.3, 2.0)
    then = integrated(slope(0.0), first[-1], 2.0, 3.0)
    return [x for one in (first, then) for x in (*one[1], slider(one[1, 0]))]


def two_four_bars() -> rj.Scene:
    """Three upright bars on the ground and two level ones between their tops, turning as one."""
    uprights = [
        rj.RigidBody(
            f"upright{i}",
            1.0,
            1 / 12,
            position=(i, 0.5),
            angle=np.pi / 2,
            velocity=(0.5, 0.0),
            angular_velocity=-1.0,
            extent=(1.0, 0.05),
        )
        for i in range(3)
    ]
    levels = [
        rj.RigidBody(
            f"level{i}",
            1.0,
            1 / 12,
            position=(i + 0.5, 1.0),
            velocity=(1.0, 0.0),
            extent=(1.0, 0.05),
        )
        for i in range(2)
    ]
    joints = [
        rj.Revolute(ends(up)[0], rj.ground.at((float(i), 0.0))) for i, up in enumerate(uprights)
    ]
    for i, level in enumerate(levels):
        for end, up in zip(ends(level), uprights[i : i + 2], strict=True):
            joints.append(rj.Revolute(end, ends(up)[1]))
    return rj.Scene([*uprights, *levels], joints, [rj.Gravity()])


def two_four_bars_found() -> np.ndarray:
    scene = two_four_bars()
    system = rj.assemble(scene)
    made = rj.simulate(system, np.array([0.0, 4.0]), rtol=1e-10)
    return np.asarray(rj.measure(system, made, scene.bodies[0].at((0.5, 0.0))).position)[-1]


def two_four_bars_again() -> list[float]:
    """One angle from the upright: θ̈ = α sin θ."""
    alpha = G * (1.5 + 2) / (1 + 2)
    angle = integrated(lambda _, y: [y[1], alpha * np.sin(y[0])], [0.0, 1.0], 0.0, 4.0)[-1, 0]
    return [np.sin(angle), np.cos(angle)]


EXTRAPOLATED = "extrapolation in {} digits, by two numbers of steps"

PROBLEMS = (
    Problem(
        "cart and pendulum",
        "A cart of 1 kg on a spring of 10 N/m, and a rigid pendulum hinged to it, released\n"
        "from the horizontal. Places and velocities of both after 5 s.",
        "Project Chrono, unit test utest_CH_slider_pend",
        lambda: named(
            "x of the cart [m], angle [rad], x' [m/s], angle' [rad/s]",
            [-0.504537462593492, -2.161149245960109, -1.379788493752874, -0.873267630490026],
        ),
        (EXTRAPOLATED.format(40) + ", redundant coordinates", SCIPY.format("two coordinates")),
        cart_found,
        lambda: integrated(slider_pendulum_again, [0.0, 0.0, 0.0, 0.0], 0.0, 5.0)[-1],
        scene=slider_pendulum,
    ),
    Problem(
        "sprung slider crank",
        "A crank and a rod with a spring and a damper between their middles and a force\n"
        "at the slider, from rest. Crank angle, slider and rod angle after 10 s.",
        "SUNDIALS, example idasSlCrank of IDAS (Serban, Petra)",
        lambda: named(
            "crank [rad], slider [m], rod [rad]",
            [1.2756758486502394, 1.0235785589798395, -0.49881304918249874],
        ),
        (EXTRAPOLATED.format(54), "IDA's own output, five printed digits"),
        sprung_crank_found,
        lambda: [1.2757, 1.0236, -0.49881],
        scene=sprung_crank,
    ),
    Problem(
        "rigid slider crank",
        "Crank, rod and slider in a line at rest; a torque of 0.1 N m turns the crank until\n"
        "2 s. Angle, speed and slider at 0.3 s and, after eighteen turns, at 3 s.",
        "a test model of Exudyn",
        lambda: named(
            "angle (0.3 s) [rad], speed [rad/s], slider [m], "
            "angle (3 s) [rad], its speed [rad/s], its slider [m]",
            [
                *(1.4527988230446317, 6.4377456282995766, 0.2948599870005706),
                *(108.70661036342387, 46.087278403636394, 0.2529895275806229),
            ],
        ),
        (EXTRAPOLATED.format(28), SCIPY.format("one coordinate")),
        pushed_crank_found,
        pushed_crank_again,
        scene=pushed_crank,
    ),
    Problem(
        "two four-bars",
        "Three uprights and two level bars of 1 m and 1 kg, the tops starting at 1 m/s; twice in\n"
        "a turn all bars are in a line, where joints lose a rank. The first top after 4 s.",
        IFTOMM.format("problem A02"),
        lambda: named("x [m], y [m]", [0.117616102376808612, 0.993059138451325101]),
        ("one angle in multiple precision", SCIPY.format("one angle")),
        two_four_bars_found,
        two_four_bars_again,
        scene=two_four_bars,
    ),
)
