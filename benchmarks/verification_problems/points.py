"""Points on rigid links without mass."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.special

import romjax as rj

from .problem import G, Problem, integrated, named, run

IFTOMM = "IFToMM library of computational benchmark problems, {}"
SCIPY = "SciPy's DOP853 at 1e-13, {}"


class Crosswise(rj.AbstractMarkerEffect):
    """A force on a point, across its place: 2 (y, −x) times a strength."""

    at: rj.Marker
    strength: jax.Array = eqx.field(converter=jnp.asarray)
    needs_twists = False

    def wrenches(self, t, poses, twists):
        x, y = poses[0].position
        return (rj.Wrench(2 * self.strength * jnp.stack([y, -x]), jnp.zeros_like(x)),)

    def check(self):
        pass


def on_a_link(start=(1.0, 0.0), velocity=(0.0, 0.0), strength=0.0, gravity=G) -> rj.Scene:
    """A point on a rigid link without mass, whose multiplier is the pull in it."""
    bob = rj.RigidBody("bob", 1.0, 1.0, position=start, velocity=velocity)
    link = rj.Distance(bob.at(), rj.ground.at(), length=1.0)
    effects = [rj.Gravity((0.0, -gravity)), Crosswise(bob.at(), strength)]
    return rj.Scene([bob], [link], effects)


def pendulum_of(run: rj.Trajectory) -> np.ndarray:
    return np.array([*np.asarray(run.q)[-1, :2], run.multipliers[-1, 0]])


def swinging(t: float) -> np.ndarray:
    """x, y and pull of the pendulum of one metre, φ = 2 asin(k cd(√(g/L) t, k)) with k² = ½."""
    _, cn, dn, _ = scipy.special.ellipj(np.sqrt(G) * t, 0.5)
    angle = 2 * np.arcsin(np.sqrt(0.5) * cn / dn)
    # The rate by energy.
    return np.array([np.sin(angle), -np.cos(angle), 3 * G * np.cos(angle)])


def circling(t: float) -> np.ndarray:
    return np.array([np.sin(t**2), np.cos(t**2), 4 * t**2])


def circling_found() -> np.ndarray:
    x, y, _ = circling(1.0)
    scene = on_a_link((x, y), (2 * y, -2 * x), 1.0, 0.0)
    return pendulum_of(run(rj.assemble(scene), 1.0, 4.0))


def circling_again() -> np.ndarray:
    def slope(_, y):
        pull = y[2] ** 2 + y[3] ** 2
        return [y[2], y[3], 2 * y[1] - pull * y[0], -2 * y[0] - pull * y[1]]

    s, c, _ = circling(1.0)
    end = integrated(slope, [s, c, 2 * c, -2 * s], 1.0, 4.0)[-1]
    return np.array([end[0], end[1], end[2] ** 2 + end[3] ** 2])


def mass_points() -> rj.Scene:
    """Two points of 3 kg on rigid links, with a start that violates them."""
    bodies = [
        rj.RigidBody("first", 3.0, 1.0, position=(0.0, 2.0), velocity=(4.0, 0.0)),
        rj.RigidBody("second", 3.0, 1.0, position=(4.0, 5.0), velocity=(10.0, 0.0)),
    ]
    first, second = (body.at() for body in bodies)
    links = [
        rj.Distance(first, rj.ground.at(), length=2.0),
        rj.Distance(second, first, length=5.0),
        rj.Distance(second, rj.ground.at((4.0, 0.0)), length=5.0),
    ]
    return rj.Scene(bodies, links, [rj.Gravity()])


def mass_points_found() -> np.ndarray:
    system = rj.assemble(mass_points())
    q, v = rj.consistent(system)
    made = run(system, 0.0, 2.0, q0=q, v0=v)
    return np.concatenate([np.asarray(v)[[0, 3]], np.asarray(made.q)[-1, [0, 1, 3, 4]]])


def mass_points_again() -> np.ndarray:
    """Accelerations by the multipliers of the links, without stabilisation."""

    def rows(r):
        a, b = r[:2], r[2:]
        far, none = b - [4.0, 0.0], np.zeros(2)
        return np.array([[*a, *none], [*(a - b), *(b - a)], [*none, *far]])

    def slope(_, y):
        r, v = y[:4], y[4:]
        row = rows(r)
        pull, first, second = np.tile([0.0, -G], 2), v[:2], v[2:]
        bend = np.array([first @ first, (first - second) @ (first - second), second @ second])
        return [*v, *(pull - row.T @ np.linalg.solve(row @ row.T, row @ pull + bend))]

    start, given = np.array([0.0, 2.0, 4.0, 5.0]), np.array([4.0, 0.0, 10.0, 0.0])
    row = rows(start)
    given = given - row.T @ np.linalg.solve(row @ row.T, row @ given)
    return np.concatenate([given[[0, 2]], integrated(slope, [*start, *given], 0.0, 2.0)[-1, :4]])


PROBLEMS = (
    Problem(
        "pendulum",
        "A point of 1 kg on a massless link of 1 m, released from the horizontal.\n"
        "Its place and the pull in the link after 10 s, more than four periods.",
        IFTOMM.format("problem A01"),
        lambda: named("x [m], y [m], pull [N]", swinging(10.0)),
        ("Jacobi's elliptic functions", "the same to 22 digits in multiple precision, as stored"),
        lambda: pendulum_of(run(rj.assemble(on_a_link()), 0.0, 10.0)),
        lambda: [0.2750874625761168600544, -0.9614192050991250642651, 28.2945672060672506],
        scene=on_a_link,
    ),
    Problem(
        "particle on a circle",
        "A particle is driven around the unit circle by a force across its place, 2 (y, −x),\n"
        "from t = 1 s. Its place and the multiplier of the constraint at t = 4 s.",
        "Arévalo and Lubich, BIT 35, 1995",
        lambda: named("x [m], y [m], pull [N]", circling(4.0)),
        ("closed form: sin t², cos t², 4 t²", SCIPY.format("the pull as the square of the speed")),
        circling_found,
        circling_again,
        scene=on_a_link,
    ),
    Problem(
        "four-bar of mass points",
        "Two points of 3 kg on three rigid links, with velocities that violate these:\n"
        "the projected velocities, and the places after 2 s.",
        "a test model of Exudyn",
        lambda: named(
            "first x' [m/s], second x' [m/s], first x [m], first y [m], second x [m], second y [m]",
            [
                *(7.0, 7.0, 1.9642513176958342, -0.3764528668109448),
                *(2.0926320726348379, 4.6218986996318651),
            ],
        ),
        ("17 digits of an independent code", SCIPY.format("by multipliers of the links")),
        mass_points_found,
        mass_points_again,
        scene=mass_points,
    ),
)
