"""Motions whose bodies turn up to a hundred times, or swing far, or go round: angles and places
are as accurate as after three turns; and those that pass close to an unstable equilibrium.
"""

import jax
import numpy as np
import pytest
from comparison import assert_close
from scipy.integrate import solve_ivp
from tolerances import IDENTITY
from zoo import GRAVITY, RODAS5P, bar, system

import romjax as rj
from romjax.integrate.default import default_method
from romjax.integrate.turning import turning, turning_rtol
from romjax.system.frequencies import frequencies

RTOL = 1e-6  # of `simulate` with nothing set
ALLOWED = 100 * RTOL  # of the motion's size
SPIN = 12.0
LET_GO = -np.pi / 2 + 2.0
TURNS = np.array([3.0, 10.0, 30.0, 100.0])
MOMENTS, WAY = np.array([1.0, 2.0, 2.7]), np.array([0.6, 0.48, 0.64])
TIGHT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}


def pendulum(spin=SPIN) -> rj.Scene:
    """A bar on its hinge that goes round."""
    return bar(angle=-np.pi / 2, spin=spin)


def tip(run) -> np.ndarray:
    """The direction of the bar."""
    angle = run["bar1.phi"]
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def true_tip(ts, angle=-np.pi / 2, spin=SPIN) -> np.ndarray:
    """φ'' = −3 g cos φ / (2 L) of a bar of one metre."""
    seen = solve_ivp(
        lambda t, y: [y[1], -1.5 * GRAVITY * np.cos(y[0])],
        (0.0, ts[-1]), [angle, spin], t_eval=ts, **TIGHT,
    )  # fmt: skip
    return np.stack([np.cos(seen.y[0]), np.sin(seen.y[0])], -1)


def swinging() -> rj.Scene:
    """A bar that is let go two radians from its equilibrium."""
    return bar(angle=LET_GO)


def tumbler(spin=SPIN) -> rj.Scene:
    """A body of three moments of inertia that turns freely in space."""
    return rj.Scene([rj.spatial.RigidBody("body", 1.0, MOMENTS, angular_velocity=spin * WAY)])


def quaternion(run) -> np.ndarray:
    """Of a body that starts at (1, 0, 0, 0), with the length one."""
    p = np.asarray(run.q)[..., 3:7]
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def true_quaternion(ts) -> np.ndarray:
    """Euler's equations, and p' = p (0, ω) / 2."""

    def rate(t, y):
        p, spin = y[:4], y[4:]
        turned = np.append(-p[1:] @ spin, p[0] * spin + np.cross(p[1:], spin)) / 2
        return np.append(turned, -np.cross(spin, MOMENTS * spin) / MOMENTS)

    start = [1.0, 0.0, 0.0, 0.0, *SPIN * WAY]
    return solve_ivp(rate, (0.0, ts[-1]), start, t_eval=ts, **TIGHT).y[:4].T


STIFFNESS, LENGTH, SPEED = 288.0, 0.5, 10.0


def satellite() -> rj.Scene:
    """A body that goes round on a spring, in ovals, and does not turn."""
    body = rj.RigidBody("body", 1.0, 0.1, position=(1.0, 0.0), velocity=(0.0, SPEED))
    spring = rj.Spring(body.at(), rj.ground.at(), STIFFNESS, rest_length=LENGTH)
    return rj.Scene([body], effects=[spring])


def position(run) -> np.ndarray:
    return np.stack([run["body.x"], run["body.y"]], -1)


def true_position(ts) -> np.ndarray:
    """By r'' = −k (1 − l / r) r of one kilogram."""

    def rate(t, y):
        return [*y[2:], *(-STIFFNESS * (1 - LENGTH / np.hypot(*y[:2])) * y[:2])]

    return solve_ivp(rate, (0.0, ts[-1]), [1.0, 0.0, 0.0, SPEED], t_eval=ts, **TIGHT).y[:2].T


CASES = {
    "whirling": (pendulum, tip, true_tip),
    "swinging": (swinging, tip, lambda ts: true_tip(ts, LET_GO, 0.0)),
    "tumbling": (tumbler, quaternion, true_quaternion),
    "going round": (satellite, position, true_position),
}


@pytest.mark.slow
@pytest.mark.parametrize("solver", [None, RODAS5P], ids=["default", "Rodas5P"])
@pytest.mark.parametrize("case", CASES)
def test_many_turns(case, solver):
    """Under `jit` and `vmap` too, where lanes turn up to different times."""
    make, seen, truth = CASES[case]
    every = 2 * np.pi * TURNS[:, None] / SPIN * np.linspace(0.0, 1.0, 101)
    whole = rj.assemble(make())

    def lane(ts):
        run = rj.simulate(whole, ts, solver=solver, throw=False)
        return run.q, run.flags

    q, flags = jax.jit(jax.vmap(lane))(every)
    assert not np.any(flags)
    runs = [rj.simulate(whole, ts, solver=solver) for ts in every]
    assert all(run.is_valid for run in runs)
    for ts, run, own in zip(every, runs, q, strict=True):
        assert_close(seen(run), truth(ts), ALLOWED)
        # Both take the same steps, but for rounding.
        assert_close(own, run.q, ALLOWED / 100, np.max(np.abs(own)))


@pytest.mark.slow
def test_many_turns_by_joint_coordinates():
    joint = rj.reduce(rj.assemble(pendulum()), formulation=rj.JointCoordinates())
    ts = 2 * np.pi * 30 / SPIN * np.linspace(0.0, 1.0, 101)
    for solver in (None, RODAS5P):
        assert_close(tip(rj.simulate(joint, ts, solver=solver)), true_tip(ts), ALLOWED)


@pytest.mark.slow
def test_swings_in_space_by_joint_coordinates():
    """Thirty, which were off by 1.3e-3."""
    c, s = np.cos(LET_GO), np.sin(LET_GO)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rod = rj.spatial.RigidBody(
        "rod", 1.0, np.array([1e-4, 1 / 12, 1 / 12]), turned[:, 0] / 2, orientation=turned
    )
    hinge = rj.spatial.Revolute(rod.at((-0.5, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0)))
    whole = rj.assemble(rj.Scene([rod], [hinge], [rj.Gravity((0.0, -GRAVITY, 0.0))]))
    joint, ts = rj.reduce(whole, formulation=rj.JointCoordinates()), np.linspace(0.0, 49.2, 101)
    run = rj.simulate(joint, ts)
    assert run.is_valid
    tips = 2 * np.stack([run["rod.x"], run["rod.y"]], -1)
    assert_close(tips, true_tip(ts, LET_GO, 0.0), ALLOWED)


@pytest.mark.slow
def test_many_swings():
    """Of three hundred, a hundred outputs show little: their errors were 3e-2, by Rodas5P."""
    angle, ts = -np.pi / 2 + 1.2, np.linspace(0.0, 492.0, 101)
    run = rj.simulate(rj.assemble(bar(angle=angle)), ts)
    assert run.is_valid
    assert run.solver_name == "Dopri8"
    assert_close(tip(run), true_tip(ts, angle, 0.0), ALLOWED)


@pytest.mark.parametrize(
    ("lean", "spin", "end"), [(0.05, 0.0, 5.0), (0.08, 0.2, 6.0), (0.1, 0.4, 6.0), (0.12, 0.4, 6.0)]
)
def test_close_to_its_top(lean, spin, end):
    """A bar that is let go near its top, and comes back there: it magnifies what a start is wrong
    by 119, 157, 441 and 277 times, and no flag can tell that.
    """
    ts, angle = np.linspace(0.0, end, 101), np.pi / 2 + lean
    run = rj.simulate(rj.assemble(bar(angle=angle, spin=spin)), ts)
    assert run.is_valid
    assert_close(tip(run), true_tip(ts, angle, spin), ALLOWED)


def test_tolerances_go_with_the_square_of_the_turns():
    """Up to a hundred, which costs some times as many steps at most."""
    rates = 2 * np.pi * np.array([0.0, 3.0, 30.0, 100.0, 1e9])
    shares = [1.0, 1.0, 1e-2, 9e-4, 9e-4]
    finer = [turning_rtol(RTOL, rate, 1.0) for rate in rates]
    assert_close(finer, RTOL * np.array(shares), IDENTITY)
    finer = [turning_rtol(RTOL, rate, 1.0, 5.0) for rate in rates[:3]]
    assert_close(finer, RTOL * np.array([0.36, 0.36, 1e-2]), IDENTITY)
    # Nothing gets finer than rounding allows, and what is asked for stays, however fine.
    assert_close(turning_rtol(1e-12, rates[2], 1.0), 500 * np.finfo(float).eps, IDENTITY)
    assert turning_rtol(1e-14, rates[2], 1.0) == 1e-14


def fastest(whole) -> jax.Array:
    return jax.jit(lambda q, v: turning(whole, 0.0, q, v, None))(whole.q0, whole.v0)


def test_how_fast_bodies_turn():
    assert_close(fastest(system(pendulum)), SPIN, IDENTITY, SPIN)
    # A bar of one metre falls from the level with 1.5 g, and counts as √(0.75 g).
    assert_close(fastest(system(bar)), np.sqrt(0.75 * GRAVITY), IDENTITY)
    spin = SPIN * WAY
    change = np.linalg.norm(np.cross(MOMENTS * spin, spin) / MOMENTS)
    wanted = np.sqrt(spin @ spin + change / 2)
    assert_close(fastest(rj.assemble(tumbler())), wanted, IDENTITY, wanted)


def sprung(position, *effects, at=0.0, velocity=0.0) -> rj.Scene:
    """A body that is let go on a spring, whose other end is somewhere, or hit."""
    own = {"position": (at + position, 0.0), "velocity": (velocity, 0.0)}
    body = rj.RigidBody("body", 1.0, 0.1, **own)
    spring = rj.Spring(body.at(), rj.ground.at((at, 0.0)), STIFFNESS, rest_length=LENGTH)
    return rj.Scene([body], effects=[spring, *(make(body) for make in effects)])


def test_how_fast_bodies_swing_that_do_not_turn():
    """Let go far from equilibrium, they count as √(k / 2 m), and close to it as √(a / 2 ℓ) with
    their radius of gyration, wherever the origin is; not at all where dampers end that
    within some vibrations.
    Those that are hit at their equilibrium count as √(ω v / 2 ℓ).
    """
    # The mean of both axes in the plane, of which it has inertia about none.
    gyration, pulled = np.sqrt(0.1 / 2), 0.1 * STIFFNESS
    for at in (0.0, 1000.0):
        assert_close(fastest(rj.assemble(sprung(1.0, at=at))), np.sqrt(STIFFNESS / 2), 1e-6, 1.0)
    close = fastest(rj.assemble(sprung(LENGTH + 0.1)))
    assert_close(close, np.sqrt(pulled / gyration / 2), IDENTITY, 1.0)
    hit = rj.assemble(sprung(LENGTH, velocity=0.1))
    wanted = np.sqrt(np.sqrt(STIFFNESS) * 0.1 / gyration / 2)
    assert_close(fastest(hit), wanted, 1e-6, 1.0)
    for damping, counts in ((0.1, 1.0), (1.0, 0.0)):
        damped = sprung(1.0, lambda body, d=damping: rj.Damper(body.at(), rj.ground.at(), d))
        assert_close(fastest(rj.assemble(damped)), counts * np.sqrt(STIFFNESS / 2), 1e-6, 1.0)


def test_free_flight_is_no_swing():
    ball = rj.RigidBody("ball", 1.0, 1e-4, velocity=(SPEED, SPEED))
    assert_close(fastest(rj.assemble(rj.Scene([ball], effects=[rj.Gravity()]))), 0.0, 1e-6)


def mass_between_springs(at=0.0, position=LENGTH, velocity=0.0) -> rj.Scene:
    """On a rail across a spring that is stretched a little: the farther, the faster."""
    own = {"position": (at + position, 0.0), "velocity": (velocity, 0.0)}
    body = rj.RigidBody("body", 1.0, 0.1, **own)
    rail = rj.Prismatic(body.at(), rj.ground.at())
    spring = rj.Spring(body.at(), rj.ground.at((at, 1.0)), STIFFNESS, rest_length=0.9)
    return rj.Scene([body], [rail], [spring])


def true_vibration(ts, start, stiffness, velocity=0.0) -> np.ndarray:
    """By x'' = −k (1 − l / r) x of one kilogram, on a spring whose other end is a metre aside."""

    def rate(t, y):
        return [y[1], -stiffness * (1 - 0.9 / np.hypot(y[0], 1.0)) * y[0]]

    return solve_ivp(rate, (0.0, ts[-1]), [start, velocity], t_eval=ts, **TIGHT).y[0]


@pytest.mark.slow
def test_many_swings_without_a_turn():
    """A hundred and twelve, which were off by 1.1e-2; wherever the origin is."""
    ts = np.linspace(0.0, 100.0, 101)
    truth = true_vibration(ts, LENGTH, STIFFNESS)
    for at in (0.0, 1000.0):
        run = rj.simulate(rj.assemble(mass_between_springs(at)), ts)
        assert run.is_valid
        assert run.solver_name == "Dopri8"
        assert_close(run["body.x"] - at, truth, ALLOWED, 2 * LENGTH)


@pytest.mark.slow
def test_many_vibrations_of_a_mass_that_is_hit():
    """Where its acceleration is zero."""
    ts = np.linspace(0.0, 100.0, 101)
    run = rj.simulate(rj.assemble(mass_between_springs(position=0.0, velocity=5.0)), ts)
    assert run.is_valid
    truth = true_vibration(ts, 0.0, STIFFNESS, velocity=5.0)
    assert_close(run["body.x"], truth, ALLOWED, np.max(np.abs(truth)))


def wheel(spin) -> rj.Scene:
    """A carriage on a stiff spring with a damper, and a balanced wheel on it."""
    carriage = rj.RigidBody("carriage", 1.0, 1.0)
    wheel = rj.RigidBody("wheel", 1.0, 0.1, angular_velocity=spin)
    ends = carriage.at(), rj.ground.at()
    joints = [rj.Prismatic(*ends), rj.Revolute(wheel.at(), carriage.at())]
    parts = [rj.Spring(*ends, 1e6, rest_length=0.0), rj.Damper(*ends, 1e3)]
    return rj.Scene([carriage, wheel], joints, parts)


def test_a_balanced_wheel_in_the_plane_asks_for_no_short_steps():
    """It turns without any effort, however fast: stiff is what is beside it."""
    ts = np.linspace(0.0, 1000.0, 101)

    def at_start(whole):
        return jax.jit(lambda q, v: frequencies(whole, 0.0, q, v))(whole.q0, whole.v0)

    names = {
        type(default_method(whole, ts, None, at_start(whole)).solver)
        for whole in (rj.assemble(wheel(spin)) for spin in (0.0, 1e3))
    }
    assert names == {type(RODAS5P)}
