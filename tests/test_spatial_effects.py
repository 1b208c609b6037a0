"""Effects in space: the power of all at once, and laws against closed forms."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from programs import kept
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.scene.marker import Pose, Twist

r = rj.spatial
CHANCE = np.random.default_rng(5)
BALL = r.RigidBody("ball", 2.0, (0.08, 0.08, 0.08))
ENDS = BALL.at((0, 0, 0)), rj.ground.at((0, 0, 0))
SWING = rj.Sine(0.3, 2.0, phase=0.4)
ROOT = CHANCE.normal(size=(6, 6))
STIFF, DAMP = ROOT @ ROOT.T, 0.1 * ROOT.T @ ROOT


def every_effect() -> list[rj.AbstractMarkerEffect]:
    rubbing = {"dissipation": 0.1, "friction": rj.Friction(0.3, creep=0.1)}
    return [
        rj.TorsionSpring(*ENDS, stiffness=3.0, rest_angle=0.1),
        rj.TorsionDamper(*ENDS, damping=0.8),
        rj.Motor(*ENDS, SWING, proportional=5.0, derivative=0.4),
        r.Bushing(*ENDS, STIFF, DAMP),
        r.Bushing(*ENDS, np.diag(STIFF)),
        rj.Drag(ENDS[0], coefficient=0.5, area=0.3),
        *(
            r.Contact(*ENDS, surface, stiffness=50.0, radius=radius, **law)
            for surface in (
                *(r.Plane(), r.Cylinder(3.0), r.Capsule(1.0, 2.0), r.Sphere(9.0)),
                r.Sphere(0.1, hollow=True),
            )
            for radius, law in ((None, {}), (0.3, rubbing))
        ),
    ]


@kept
def powers(effects, q, v):
    """Of each effect between bodies in a state: the power of its wrenches; what it says of it, less
    what its energy loses; and the power of each wrench.
    """
    poses = tuple(Pose(row[:3], row[3:]) for row in q)
    twists = tuple(Twist(row[:3], row[4:]) for row in v)
    rates = tuple(pose.rate(twist) for pose, twist in zip(poses, twists, strict=True))
    found = []
    for effect in effects:
        count = len(effect.markers) + len(effect.counted)
        now, moving, changing = poses[:count], twists[:count], rates[:count]
        terms = jnp.stack(
            [
                wrench.power(twist)
                for wrench, twist in zip(effect.wrenches(0.3, now, moving), moving, strict=True)
            ]
        )
        lost = jax.jvp(lambda *x, e=effect: e.energy(0.3, *x), now, changing)[1]
        found.append((jnp.sum(terms), effect.power(0.3, now, moving) - lost, terms))
    return found


def test_power():
    """Of the wrenches of each: what its energy loses, and the power it says it puts in."""
    q, v = (CHANCE.normal(size=(3, 7)) for _ in range(2))
    for total, said, terms in powers(every_effect(), q, v):
        assert_close(total, said, 10 * IDENTITY, 1 + np.sum(np.abs(terms)))


@pytest.mark.slow
def test_wrenches_have_their_derivatives():
    """Of each, along some direction, by central differences."""
    q, v, dq, dv = (jnp.asarray(CHANCE.normal(size=(3, 7))) for _ in range(4))

    def wrenches(q, v):
        poses = tuple(Pose(row[:3], row[3:]) for row in q)
        twists = tuple(Twist(row[:3], row[4:]) for row in v)
        found = []
        for effect in every_effect():
            count = len(effect.markers) + len(effect.counted)
            each = effect.wrenches(0.3, poses[:count], twists[:count])
            found.append(jnp.concatenate([jnp.stack(wrench) for wrench in each]))
        return found

    @jax.jit
    def slopes(step):
        ends = [wrenches(q + h * dq, v + h * dv) for h in (step, -step)]
        central = [(a - b) / (2 * step) for a, b in zip(*ends, strict=True)]
        return jax.jvp(wrenches, (q, v), (dq, dv))[1], central

    for slope, central in zip(*slopes(1e-5), strict=True):
        assert_close(slope, central, DIFFERENCED, 1 + np.max(np.abs(central)))


def test_damping_and_friction_take():
    """Rayleigh's function of drag is a sixth of a cube, and friction is opposite to sliding."""
    twist = Twist(np.array([0.3, -0.4, 1.2]), np.zeros(3))
    drag = rj.Drag(ENDS[0], coefficient=0.5, area=0.3, density=1.2)
    still = rj.Friction(0.3, creep=0.1)

    @jax.jit
    def taken(twist):
        (wrench,) = drag.wrenches(0.0, (), (twist,))
        slope = jax.jacfwd(lambda v: still.against(jnp.array([0.0, 0.0, 1.0]), v))(jnp.zeros(3))
        return wrench.force, slope

    force, slope = taken(twist)
    velocity = np.array([0.3, -0.4, 1.2])
    assert_close(force, -0.5 * 1.2 * 0.5 * 0.3 * 1.3 * velocity, IDENTITY)
    assert_close(slope, 3.0 * np.diag([1.0, 1.0, 0.0]), IDENTITY, 10.0)


@pytest.mark.slow
def test_ten_turns_of_a_torsion_spring():
    wheel = r.RigidBody("wheel", 1.0, (0.1, 0.2, 0.3), angular_velocity=(0, 0, 65.0))
    ends = wheel.at((0, 0, 0)), rj.ground.at((0, 0, 0))
    spring = rj.TorsionSpring(*ends, stiffness=0.3, rest_angle=0.5)
    system = rj.assemble(rj.Scene([wheel], [r.Revolute(*ends)], [spring]))
    ts = jnp.linspace(0.0, 2.0, 5)
    run = zoo.run(system, ts, rtol=1e-12)
    wanted = 0.5 - 0.5 * np.cos(ts) + 65.0 * np.sin(ts)
    assert np.max(wanted) > 10 * 2 * np.pi
    assert_close(run.q[:, -1], wanted, SOLVED, 65.0)


@pytest.mark.slow
def test_a_ball_comes_to_roll():
    """One that slides at first rolls at 5/7 of its speed, whatever rubs."""
    ball = r.RigidBody(
        "ball", 2.0, np.full(3, 0.4 * 2.0 * 0.3**2), (0, 0, 0.3), velocity=(1.0, 0.5, 0.0)
    )
    floor = r.Contact(
        ball.at((0, 0, 0)),
        rj.ground.at((0, 0, 0)),
        r.Plane(),
        stiffness=1e5,
        radius=0.3,
        dissipation=1.0,
        friction=rj.Friction(0.4, creep=1e-2),
    )
    system = rj.assemble(rj.Scene([ball], [], [floor, rj.Gravity((0, 0, -9.81))]))
    run = rj.simulate(system, jnp.array([0.0, 1.0]), rtol=1e-8, audit=False)
    speed = np.array([1.0, 0.5]) * 5 / 7
    # Sliding that is left decays at 7/2 μ g / creep, and the floor gives by micrometres.
    assert_close(run.v[-1, :2], speed, DIFFERENCED, 1.0)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: r.Bushing(*ENDS, np.ones(5)), "six numbers"),
        (lambda: r.Bushing(*ENDS, np.triu(STIFF)), "not symmetric"),
        (lambda: r.Bushing(*ENDS, -STIFF), "may be negative"),
        (lambda: r.Contact(*ENDS, r.Sphere(-1.0), stiffness=1.0), "Sphere.radius"),
        (lambda: rj.Drag(ENDS[0], coefficient=-1.0, area=1.0), "coefficient"),
        (lambda: rj.Torque(ENDS[0], rj.Constant(1.0), (0, 0, 0)), "direction is"),
    ],
)
def test_what_an_effect_refuses(make, words):
    with pytest.raises(rj.SceneError, match=words):
        make()


@pytest.mark.instant
def test_a_torque_takes_its_direction_before_its_signal_too():
    axis, push = (0.0, 3.0, 4.0), rj.Constant(2.0)
    for torque in (r.Torque(ENDS[0], axis, push), rj.Torque(ENDS[0], push, axis)):
        assert torque.signal is push
        np.testing.assert_array_equal(torque.direction, axis)


@pytest.mark.slow
def test_a_bushing_past_half_a_turn():
    """It swings as one spring, ½ J ω² = ½ k φ², and says so where that goes past half a turn."""
    body = r.RigidBody("body", 1.0, (0.02, 0.03, 0.05))
    stiffness = np.array([90.0, 90.0, 90.0, 5.0, 8.0, 3.0])
    bushing = r.Bushing(body.at((0, 0, 0)), rj.ground.at((0, 0, 0)), stiffness)
    system = rj.assemble(rj.Scene([body], effects=[bushing]))
    ts = np.linspace(0.0, 1.0, 6)

    def swung(most, sign):
        """A run to the largest angle `most` [rad], from a quaternion of either sign."""
        q0, v0 = np.zeros(7), np.zeros(7)
        q0[3], v0[6] = sign, 0.5 * sign * most * np.sqrt(3.0 / 0.05)
        # The audit sees the angle.
        return rj.simulate(system, ts, q0=q0, v0=v0, rtol=1e-11, solver=diffrax.Dopri8())

    for sign in (1.0, -1.0):
        run = swung(3.1, sign)
        assert run.is_valid
        angle = 2 * np.arctan2(run.q[:, 6], run.q[:, 3] * sign) * sign
        assert_close(angle, 3.1 * np.sin(np.sqrt(3.0 / 0.05) * ts), SOLVED)
        with pytest.warns(UserWarning, match="half a turn.*TorsionSpring"):
            run = swung(3.2, sign)
        assert run.flags == rj.Flag.LIMIT
        assert not run.is_valid
