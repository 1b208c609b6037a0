"""Joints: identities that all share, and what each does, against closed forms."""

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.integrate
import zoo
from comparison import assert_close
from programs import kept
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax.system import dynamics

G = 9.81


def body(name="body", **fields) -> rj.RigidBody:
    return rj.RigidBody(name, mass=2.0, inertia=0.3, **fields)


def pair(number=0) -> tuple[rj.RigidBody, rj.RigidBody]:
    one = body(f"one{number}", position=(0.4, 0.1), angle=0.3)
    return one, body(f"two{number}", position=(1.1, -0.2), angle=-0.5)


def ends(one, two) -> tuple[rj.Marker, rj.Marker]:
    return one.at((0.2, 0.1), 0.2), two.at((-0.1, 0.3), -0.4)


SWING = rj.Sine(0.3, 2.0, phase=0.4)
JOINTS = [
    rj.Weld,
    lambda *ends: rj.Prismatic(*ends, value=0.1),
    lambda *ends: rj.Distance(*ends, length=0.7),
    lambda *ends: rj.Gear(*ends, ratio=-2.5),
    lambda *ends: rj.PointOnCurve(*ends, rj.Circle(0.5)),
    lambda *ends: rj.PointOnCurve(*ends, rj.Polynomial([0.1, 0.2, -0.3])),
    lambda *ends: rj.PrescribedAngle(*ends, SWING),
    lambda *ends: rj.PrescribedTravel(*ends, SWING),
    lambda *ends: rj.PrescribedDistance(*ends, SWING),
]


@kept
def both(system, t, q, v):
    """C_q and what is known of the constraints, and their derivatives along a parabola."""
    a, _ = system.acceleration(t, q, v)

    def along(s):
        return system.constraint(t + s, q + s * v + s**2 / 2 * a)

    rate = jax.jacfwd(along)
    found = dynamics.jacobian(system, t, q), dynamics.constraint_state(system, t, q, v)
    wanted = jax.jacfwd(system.constraint, argnums=1)(t, q), along(0.0), rate(0.0)
    return found, (*wanted, jax.jacfwd(rate)(0.0))


def test_derivatives():
    """C_q, Ċ and C_q a − γ along any motion, against JAX's derivatives of C along a parabola, of
    each kind of joint between two bodies of its own.
    """
    pairs = [pair(number) for number in range(len(JOINTS))]
    joints = [make(*ends(*bodies)) for make, bodies in zip(JOINTS, pairs, strict=True)]
    system = rj.assemble(rj.Scene([b for bodies in pairs for b in bodies], joints, [rj.Gravity()]))
    q, v = np.random.default_rng(1).normal(size=(2, system.n))

    found, expected = both(system, np.asarray(0.3), q, v)
    (rows, state), (wanted, violation, rate, second) = found, expected
    assert_close(rows, wanted, IDENTITY)
    assert_close(state.violation, violation, IDENTITY)
    assert_close(state.rate, rate, IDENTITY)
    size = 1 + np.abs(state.curvature)
    assert_close(second / size, 0, IDENTITY)


def test_a_weld_makes_one_body():
    """The acceleration of two bodies under gravity on one hinge is that of their sum."""
    one, two = body("one", position=(0.5, 0.0)), body("two", position=(1.5, 0.0))
    joints = [
        rj.Revolute(one.at((-0.5, 0.0)), rj.ground.at()),
        rj.Weld(two.at((-0.5, 0.0)), one.at((0.5, 0.0))),
    ]
    system = rj.assemble(rj.Scene([one, two], joints, [rj.Gravity()]))
    a, _ = jax.jit(system.acceleration)(0.0, system.q0, system.v0)
    inertia = 2 * 0.3 + 2.0 * (0.5**2 + 1.5**2)
    wanted = -G * 2.0 * (0.5 + 1.5) / inertia
    assert_close(np.asarray(a)[[2, 5]], wanted, IDENTITY, G)


def test_gears_reflect_inertia():
    """A force on the rim of one wheel turns both: J_b + ratio² J_a."""
    a, b = body("a", position=(1.0, 0.0)), body("b")
    joints = [
        rj.Revolute(a.at(), rj.ground.at((1.0, 0.0))),
        rj.Revolute(b.at(), rj.ground.at()),
        rj.Gear(a.at(), b.at(), ratio=-3.0),
    ]
    push = rj.Force(b.at((0.5, 0.0)), (0.0, 1.0), rj.Constant(4.0))
    system = rj.assemble(rj.Scene([a, b], joints, [push]))
    found, _ = jax.jit(system.acceleration)(0.0, system.q0, system.v0)
    wanted = 0.5 * 4.0 / (0.3 + 9 * 0.3)
    assert_close(np.asarray(found)[[5, 2]], [wanted, -3 * wanted], SOLVED)


def belt(*bearing: rj.Marker) -> rj.Scene:
    """Two wheels on an arm that swings: one at its end, the other at its hinge, on the ground."""
    arm = rj.RigidBody("arm", 1.5, 0.08, position=(0.4, 0.0))
    small, big = body("small", position=(0.8, 0.0)), body("big")
    joints = [
        rj.Revolute(arm.at((-0.4, 0.0)), rj.ground.at()),
        rj.Revolute(small.at(), arm.at((0.4, 0.0))),
        rj.Revolute(big.at(), rj.ground.at()),
        rj.Gear(small.at(), big.at(), *bearing, ratio=3.0),
    ]
    return rj.Scene([arm, small, big], joints, [rj.Gravity()])


def test_wheels_on_an_arm():
    """Angles are against the arm: θ_a − φ = ratio (θ_b − φ)."""
    system = rj.assemble(belt(rj.Marker("arm", np.zeros(2), np.zeros(()))))
    found, _ = jax.jit(system.acceleration)(0.0, system.q0, system.v0)
    # Of the arm with both wheels' mass, and of the turns 3 θ − 2 φ and θ of the wheels.
    swing = 0.08 + 1.5 * 0.4**2 + 2.0 * 0.8**2
    matrix = np.array([[swing + 0.3 * 2**2, -0.3 * 6], [-0.3 * 6, 0.3 * 3**2 + 0.3]])
    wanted = np.linalg.solve(matrix, [-G * (1.5 * 0.4 + 2.0 * 0.8), 0.0])
    assert_close(np.asarray(found)[[2, 8]], wanted, SOLVED, G)


@pytest.mark.instant
def test_a_wheel_on_an_arm_needs_a_bearing():
    with pytest.raises(rj.SceneError, match="'small' turns on 'arm'.*give bearing_a"):
        belt().check()


TS = np.linspace(0.0, 2.0, 11)
ANGLE = -0.4


@pytest.fixture(scope="module")
def bead():
    """A point on a string of 0.8 m, released from 1 rad, by an equation of its own."""

    def slope(t, y):
        return [y[1], -G / 0.8 * np.sin(y[0])]

    tight = {"rtol": 1e-12, "atol": 1e-12}
    angle = scipy.integrate.solve_ivp(slope, (0, 2), [1.0, 0.0], "DOP853", TS, **tight).y[0]
    return 0.8 * np.stack([np.sin(angle), -np.cos(angle)], axis=1)


@pytest.fixture(scope="module")
def moving(bead):
    """A block on an incline, a wheel whose angle is a ramp, and two beads, each by itself."""
    block, wheel = body("block", angle=ANGLE), body("wheel", angle=0.2, angular_velocity=1.5)
    one, two = (body(name, position=bead[0]) for name in ("one", "two"))
    joints = [
        rj.Prismatic(block.at(), rj.ground.at((0.0, 0.0), ANGLE)),
        rj.Revolute(wheel.at(), rj.ground.at()),
        rj.PrescribedAngle(wheel.at(), rj.ground.at(), rj.Ramp(1.5), name="drive"),
        rj.Distance(one.at(), rj.ground.at(), length=0.8),
        rj.PointOnCurve(two.at(), rj.ground.at(), rj.Circle(0.8)),
    ]
    scene = rj.Scene([block, wheel, one, two], joints, [rj.Gravity()])
    return zoo.run(rj.assemble(scene), TS, rtol=1e-11)


def coordinates(run, name) -> np.ndarray:
    """Of a body, (k, 3)."""
    return np.stack([run[f"{name}.{x}"] for x in ("x", "y", "phi")], axis=1)


def test_a_slide_on_an_incline(moving):
    """The way is g sin(angle) t² / 2, and the body keeps its angle."""
    way = G * np.sin(-ANGLE) * TS**2 / 2
    wanted = np.stack([way * np.cos(ANGLE), way * np.sin(ANGLE), 0 * way + ANGLE], axis=1)
    assert_close(coordinates(moving, "block"), wanted, SOLVED)


@pytest.mark.parametrize("name", ["one", "two"])
def test_a_link_and_a_round_track_make_a_pendulum(bead, moving, name):
    assert_close(coordinates(moving, name)[:, :2], bead, SOLVED)


@pytest.mark.slow
def test_prescribed_motion():
    """A wheel whose angle is given takes the torque J φ̈, and a cart the force m ẍ."""
    wheel, cart = body("wheel"), body("cart", position=(0.0, 1.0))
    angle, travel = rj.Sine(0.2, 1.5, phase=np.pi / 2), rj.Step(0.4, 0.1, 0.8)
    joints = [
        rj.Revolute(wheel.at(), rj.ground.at()),
        rj.PrescribedAngle(wheel.at(), rj.ground.at(), angle),
        rj.Prismatic(cart.at(), rj.ground.at((0.0, 1.0))),
        rj.PrescribedTravel(cart.at(), rj.ground.at((0.0, 1.0)), travel),
    ]
    system = rj.assemble(rj.Scene([wheel, cart], joints, []))
    ts = np.linspace(0.0, 1.0, 21)
    q0 = np.asarray(system.q0).copy()
    q0[2] = 0.2
    run = zoo.run(system, ts, q0=q0, rtol=1e-12)
    for place, row, signal, inertia in ((2, 2, angle, 0.3), (3, 5, travel, 2.0)):
        value, push = jax.jit(jax.vmap(lambda t, s=signal: (s(t), jax.grad(jax.grad(s))(t))))(ts)
        assert_close(np.asarray(run.q)[:, place], value, SOLVED)
        wanted = -inertia * np.asarray(push)
        assert_close(np.asarray(run.multipliers)[:, row], wanted, SOLVED * 100)


def test_uniform_turning(moving):
    """A wheel whose angle is a ramp turns uniformly from where it stands, and takes no torque."""
    assert_close(coordinates(moving, "wheel")[:, 2], 0.2 + 1.5 * TS, SOLVED)
    assert_close(moving["wheel.phi'"], 1.5, SOLVED)
    torque = rj.joint_forces(moving.system, moving)["drive"].torque
    assert_close(torque, 0, SOLVED)


def test_a_joint_of_ones_own():
    """Five lines: a belt that pulls a body along as a wheel turns."""

    class Belt(rj.AbstractJoint):
        a: rj.Marker
        b: rj.Marker
        name: str = eqx.field(static=True, default="belt")
        rows = 1

        def residual(self, t, a, b):
            return (a.position[0] - 0.25 * b.angle)[None]

    cart, wheel = body("cart"), body("wheel")
    system = rj.assemble(rj.Scene([cart, wheel], [Belt(cart.at(), wheel.at())], []))
    _, multipliers = jax.jit(system.acceleration)(0.0, system.q0, system.v0)
    assert multipliers.shape == (1,)
    rows = eqx.filter_jit(dynamics.jacobian)(system, 0.0, system.q0)
    assert_close(rows, [[1, 0, 0, 0, 0, -0.25]], IDENTITY)


def test_signals():
    t = 0.7
    wanted = 2 * np.sin(2 * np.pi * (t + 1.5 * t**2))
    assert_close(rj.Chirp(2.0, 1.0, 3.0)(t), wanted, IDENTITY)
    step = rj.Step(2.0, 0.5, 0.4)
    assert_close([step(0.4), step(0.7), step(1.0)], [0, 1, 2], IDENTITY)
    assert_close(rj.Sum((step, rj.Constant(3.0)))(t), 4, IDENTITY)
    assert_close(rj.Ramp(2.0, 0.5)(t), 2.0 * 0.7 + 0.5, IDENTITY)


@pytest.mark.instant
def test_what_a_joint_refuses():
    given = ends(*pair())
    with pytest.raises(rj.SceneError, match="signal is a Table, whose kinks"):
        rj.PrescribedAngle(*given, rj.Table([0.0, 1.0], [0.0, 1.0]))
    kinked = rj.Sum((rj.Table([0.0, 1.0], [0.0, 1.0]), SWING))
    with pytest.raises(rj.SceneError, match="signal is a Sum, whose kinks"):
        rj.PrescribedTravel(*given, kinked)
    with pytest.raises(rj.SceneError, match="signal is 1.0; give a signal"):
        rj.PrescribedAngle(*given, 1.0)
    with pytest.raises(rj.SceneError, match="length is -1.*positive.*Revolute"):
        rj.Distance(*given, length=-1.0)
    with pytest.raises(rj.SceneError, match="Circle.radius is 0.*positive"):
        rj.PointOnCurve(*given, rj.Circle(0.0))
    with pytest.raises(rj.SceneError, match="Step.duration is 0"):
        rj.PrescribedAngle(*given, rj.Step(1.0, 0.0, 0.0))
