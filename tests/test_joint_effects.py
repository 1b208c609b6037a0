"""Springs, damping, friction, stops, motors and inertia in a hinge, against its own equation."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from programs import kept
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import run

import romjax as rj
from romjax import spatial as r
from romjax.integrate.default import default_method, start_frequencies
from romjax.reduction.joint.formulation import size_in_joint_coordinates
from romjax.scene.effect.joint_damper import ANY

MASS, ARM, INERTIA, ROTOR = 2.0, 0.3, 0.5, 0.7
UPPER, LEAST = 0.4, -0.5
STATES = (0.2, 0.5, 0.3), (0.6, 0.4, 0.3), (0.6, -4.0, -0.1), (-0.7, -0.3, 5.0), (0.1, 1, -9)


def pendulum(angle, speed, signal):
    """A hinge about the z axis with all that there is, in space; gravity along −y."""
    turn = r.rotation((0.0, 0.0, 1.0), angle)
    at = (ARM * np.cos(angle), ARM * np.sin(angle), 0.0)
    moving = (-speed * at[1], speed * at[0], 0.0)
    bar = r.RigidBody(
        "bar", MASS, (0.4, 0.4, INERTIA), at, turn, moving, angular_velocity=(0.0, 0.0, speed)
    )
    ends = bar.at((-ARM, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
    effects = [
        rj.Gravity((0.0, -9.81, 0.0)),
        rj.JointSpring(*ends, 3.0, 0.1, "bounded angle"),
        rj.JointDamper(*ends, 0.2, rj.Friction(0.6, creep=1e-2)),
        rj.JointStop(*ends, LEAST, UPPER, 50.0, 0.3, "bounded angle"),
        rj.Actuator(
            *ends, rj.Constant(signal), gear=5.0, gain=2.0, proportional=0.3, derivative=0.1,
            least=-4.0, largest=4.0, motion="bounded angle",
        ),
        r.JointInertia(*ends, ROTOR),
    ]  # fmt: skip
    return rj.Scene([bar], [r.Revolute(*ends)], effects)


def expected(angle, speed, signal):
    """The angular acceleration by Euler's equation of the hinge."""
    beyond = max(angle - UPPER, 0) + min(angle - LEAST, 0)
    force = np.clip(2 * signal - 5 * (0.3 * angle + 0.1 * speed), -4, 4)
    torque = (
        -MASS * 9.81 * ARM * np.cos(angle)
        - 3 * (angle - 0.1)
        - 0.2 * speed
        - 0.6 * np.tanh(speed / 1e-2)
        - 50 * beyond * max(1 + 0.3 * np.sign(beyond) * speed, 0)
        + 5 * force
    )
    return torque / (INERTIA + MASS * ARM**2 + ROTOR)


@kept
def rates(system):
    return system.acceleration(0.0, system.q0, system.v0)[0]


def test_a_hinge_with_everything_obeys_its_own_equation():
    """Between and beyond both stops, the motor within and at its largest force, both ways."""
    for state in STATES:
        system = rj.assemble(pendulum(*state))
        assert system.structure.labels[-1].endswith("angle")
        assert_close(system.q0[-1], state[0], IDENTITY)
        assert_close(rates(system)[-1], expected(*state), IDENTITY, 100.0)


def test_a_ball_joint_has_damping_and_stops_at_an_angle():
    """About any axis: between, and beyond them on the way out and back; from p = (c, n s) with the
    half angle. The start, which is not turned, shows how stiff they are.
    """
    axis, largest, stiffness, damping = np.array([2.0, -1.0, 2.0]) / 3, 0.5, 40.0, 0.3
    for angle, speed in ((0.2, 1.5), (0.9, 1.1), (0.9, -0.7), (0.0, 0.0)):
        ball = r.RigidBody(
            "ball", MASS, np.full(3, INERTIA), (0.0, 0.0, 0.0), r.rotation(axis, angle),
            angular_velocity=speed * axis,
        )  # fmt: skip
        ends = ball.at((0.0, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
        stop = rj.JointStop(*ends, None, largest, stiffness, 0.4, "turn")
        system = rj.assemble(
            rj.Scene(
                [ball], [r.Spherical(*ends)], [stop, rj.JointDamper(*ends, damping, motion=ANY)]
            )
        )
        beyond = max(angle - largest, 0.0)
        rate = -(stiffness * beyond * (1 + 0.4 * speed) + damping * speed) / INERTIA
        c, s = np.cos(angle / 2), np.sin(angle / 2)
        known = [-rate * s / 2 - speed**2 * c / 4, *(axis * (rate * c / 2 - speed**2 * s / 4))]
        assert_close(rates(system)[3:], np.array(known), IDENTITY, 100.0)
    start = start_frequencies(system, np.linspace(0.0, 1.0, 11), system.q0, system.v0)
    assert_close(start.acting, np.sqrt(stiffness / INERTIA), DIFFERENCED, 9.0)


def test_joint_coordinates_have_the_rotor():
    """It moves as their hinge does: M has its inertia, by the recursion and as a matrix. What acts
    in the hinge acts on its coordinate, but for the spring that counts turns.
    """
    for state in STATES:
        joint = rj.reduce(rj.assemble(pendulum(*state)), formulation=rj.JointCoordinates())
        assert len(joint.along.numbers) == 4
        rate, mass, solved = both(joint)
        assert_close(rate, expected(*state), IDENTITY, 100.0)
        assert_close(solved, rate, IDENTITY, 100.0)
        assert_close(mass, INERTIA + MASS * ARM**2 + ROTOR, IDENTITY)


@eqx.filter_jit
def joint_power(system):
    return jnp.stack(system.state(0.3, system.q0, system.v0).power())


@eqx.filter_jit
def both(system):
    state = system.state(0.0, system.q0, system.v0)
    rate = system.acceleration(0.0, system.q0, system.v0)[0][0]
    return rate, state.mass()[0, 0], state.kkt().solve(state.force(), jnp.zeros(0))[0][0]


def test_joint_coordinates_refuse_rotors_of_other_motions():
    """Of a distance, for one; nor is such a model offered."""
    scene = pendulum(0.2, 0.5, 0.3)
    bar, hinge = scene.bodies[0], scene.joints[0]
    apart = bar.at((0.0, 0.0, 0.0)), rj.ground.at((0.0, 1.0, 0.0))
    refuse_rotor(bar, hinge, r.JointInertia(*apart, ROTOR, "distance"))


@pytest.mark.slow
def test_joint_coordinates_refuse_rotors_about_other_axes():
    scene = pendulum(0.2, 0.5, 0.3)
    bar, hinge = scene.bodies[0], scene.joints[0]
    end, base, axis = (-ARM, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 1.0)
    tilted = bar.at(end, axis=axis), rj.ground.at(base, axis=axis)
    refuse_rotor(bar, hinge, r.JointInertia(*tilted, ROTOR, "bounded angle"))


def refuse_rotor(bar, hinge, rotor):
    system = rj.assemble(rj.Scene([bar], [hinge], [rotor]))
    with pytest.raises(rj.ReductionError, match="coordinate of no joint of the tree"):
        rj.reduce(system, formulation=rj.JointCoordinates())
    assert size_in_joint_coordinates(system) is None


@pytest.mark.slow
def test_joint_coordinates_have_rotors_that_turn_and_slide():
    """On both motions of one joint, where springs count the turns too, and what acts along it has
    its ends the other way round.
    """
    about = (0.1, 0.2, 0.0)  # the axis
    spin = np.array((0.0, 0.0, 40.0))  # three turns in the run
    bar = r.RigidBody(
        "bar", 2.0, (0.4, 0.3, 0.5),
        velocity=(0.0, 0.0, 0.3) - np.cross(spin, about), angular_velocity=spin,
    )  # fmt: skip
    ends = bar.at((0.1, 0.2, -0.3)), rj.ground.at((0.1, 0.2, -0.3))
    effects = [
        rj.Gravity((1.0, -9.81, 2.0)),
        r.JointInertia(*ends, 3.0, "travel"),
        r.JointInertia(*ends, ROTOR),
        rj.JointSpring(*ends, 20.0),
        rj.JointSpring(*ends, 20.0, motion="travel"),
        rj.JointDamper(*ends[::-1], 0.3, rj.Friction(0.1, creep=0.1), motion="travel"),
        rj.JointStop(*ends[::-1], -0.01, 0.02, 500.0, 0.5, motion="travel"),
        rj.Actuator(*ends[::-1], rj.Sine(2.0, 3.0), gear=2.0, motion="bounded angle"),
    ]
    system = rj.assemble(rj.Scene([bar], [r.Cylindrical(*ends)], effects))
    joint = rj.reduce(system, formulation=rj.JointCoordinates())
    ts = np.linspace(0, 0.5, 11)
    assert len(joint.along.numbers) == 4
    one = rj.simulate(system, ts, rtol=1e-11, audit=False)
    other = rj.simulate(joint, ts, rtol=1e-11)
    assert_close(other.q, one.q, SOLVED)
    assert_close(other.imbalance, 0 * ts, SOLVED, 100.0)
    assert_close(joint_power(joint), joint_power(system), IDENTITY, 100.0)
    for name, forces in rj.joint_forces(system, one).items():
        assert_close(rj.joint_forces(joint, other)[name].force, forces.force, SOLVED, 200.0)


def test_stops_are_as_stiff_as_the_system_is_fast_on_them():
    """√(k / J), with gravity, which the start between them does not show; it decides on the method
    where a rest on one would take Dopri8 ten thousand steps.
    """
    ts = np.linspace(0.0, 1.0, 101)
    for stiffness, solver in ((5e7, diffrax.Dopri8), (5e10, rj.Rodas5P)):
        bar = rj.RigidBody("bar", MASS, INERTIA, position=(0.0, -ARM), angle=-np.pi / 2)
        ends = bar.at((-ARM, 0.0)), rj.ground.at((0.0, 0.0))
        stop = rj.JointStop(*ends, upper=0.0, stiffness=stiffness)
        system = rj.assemble(rj.Scene([bar], [rj.Revolute(*ends)], [rj.Gravity(), stop]))
        start = start_frequencies(system, ts, system.q0, system.v0)
        along = (stiffness + MASS * 9.81 * ARM) / (INERTIA + MASS * ARM**2)
        assert_close(start.acting, np.sqrt(along), DIFFERENCED, np.sqrt(along))
        assert start.fastest < 10
        assert isinstance(default_method(system, ts, None, start).solver, solver)
    # Where JAX traces, nobody asks how fast: the last of these is followed by Dopri8 nevertheless.
    taken = []

    def traced(q):
        start = start_frequencies(system, ts, q, system.v0)
        taken.append(default_method(system, ts, None, start).solver)
        return start.acting

    assert jax.jit(traced)(system.q0) == np.inf
    jax.grad(traced)(system.q0)
    assert [type(solver) for solver in taken] == [diffrax.Dopri8, rj.Rodas5P]


class HalfTurn(rj.Revolute):
    """A hinge whose coordinate is half of its angle."""

    def place(self, z):
        return super().place(2 * z)

    def read(self, a, b):
        return super().read(a, b) / 2


@pytest.mark.slow
def test_effects_act_on_coordinates_that_are_their_motions_alone():
    bar = rj.RigidBody("bar", MASS, INERTIA, position=(ARM, 0.0))
    ends = bar.at((-ARM, 0.0)), rj.ground.at()
    for hinge, known in ((rj.Revolute(*ends), 1), (HalfTurn(*ends), 0)):
        scene = rj.Scene([bar], [hinge], [rj.JointSpring(*ends, 3.0, 0.2)])
        joint = rj.reduce(rj.assemble(scene), formulation=rj.JointCoordinates())
        assert len(joint.along.numbers) == known
        angle = rates(joint)[0] * (1 if known else 2)
        assert_close(angle, 3.0 * 0.2 / (INERTIA + MASS * ARM**2), IDENTITY)


def test_a_turned_slider_knows_both_ways_of_its_travel():
    """Against the slider the rail is along x of the slider, not along the rail: v cos α."""
    turn, damping, speed = 1.0, 3.0, 0.7
    slider = rj.RigidBody("slider", MASS, INERTIA, angle=turn, velocity=(speed, 0.0))
    ends = slider.at(), rj.ground.at()
    for one, share in ((ends, 1.0), (ends[::-1], np.cos(turn) ** 2)):
        damper = rj.JointDamper(*one, damping, motion="travel")
        scene = rj.Scene([slider], [rj.Prismatic(*ends, turn)], [damper])
        joint = rj.reduce(rj.assemble(scene), formulation=rj.JointCoordinates())
        assert_close(rates(joint)[0], -damping * share * speed / MASS, IDENTITY)


@pytest.mark.slow
def test_the_energies_of_the_parts_are_all_there_is():
    """That of the rotor among them; nothing is lost but to what damps, rubs and drives."""
    system = rj.assemble(pendulum(0.3, 0.5, 0.2))
    swung = run(system, np.linspace(0, 0.5, 26), audit=True)
    whole, parts = rj.energy(system, swung), rj.part_energies(system, swung)
    assert_close(sum(parts.kinetic.values()), whole.kinetic, IDENTITY)
    assert_close(whole.balance, 0 * whole.balance, SOLVED, np.max(np.abs(whole.total)))
    assert not swung.warnings()


def wheel(rate, largest, stiffness, torque):
    """A wheel of the inertia 0.27 between two stops."""
    body = rj.RigidBody("wheel", 1.0, 0.27, angular_velocity=rate)
    ends = body.at(), rj.ground.at()
    effects = [
        rj.JointStop(*ends, -largest, largest, stiffness),
        rj.Torque(body.at(), rj.Constant(torque)),
    ]
    return rj.assemble(rj.Scene([body], [rj.Revolute(*ends)], effects))


def test_steps_end_where_stops_begin():
    """Between two stops without losses: at a steady rate, and half an oscillation at each end.

    Steps that pass a kink may take their error for none, so that what is known to `rtol` a step is
    asked for at ten times of it, after five stops.
    """
    rtol, largest, rate, stiffness = 1e-6, 0.4, 3.0, 500.0
    system = wheel(rate, largest, stiffness, 0.0)
    ts, fast = np.linspace(0.0, 2.0, 41), np.sqrt(stiffness / 0.27)
    free, pushed = largest / rate, np.pi / fast
    half, after = np.divmod(ts + free, 2 * free + pushed)
    beyond = largest + rate / fast * np.sin(fast * (after - 2 * free))
    angle = (-1) ** half * np.where(after < 2 * free, rate * after - largest, beyond)
    assert_close(run(system, ts, rtol=rtol).q[:, 2], angle, 10 * rtol)


@pytest.mark.parametrize("over", [1e-4, 1e-3, 1e-2])
def test_steps_do_not_leap_over_a_stop(over):
    """A torque turns a wheel back where it is `over` beyond a stop, if there is none: within a
    step, before and after which it is free.
    """
    rtol, largest, rate, stiffness = 1e-6, 0.4, 3.0, 5e3
    slowing = 0.5 * rate**2 / (largest + over)
    fast, left = np.sqrt(stiffness / 0.27), np.sqrt(2 * slowing * over)
    back = (rate - left) / slowing + 2 * np.arctan(left * fast / slowing) / fast
    after = np.linspace(0.0, 0.2, 40)
    system = wheel(rate, largest, stiffness, -0.27 * slowing)
    angle = largest - left * after - 0.5 * slowing * after**2
    assert_close(run(system, [0.0, *(back + after)], rtol=rtol).q[1:, 2], angle, 10 * rtol)


@pytest.mark.instant
def test_motions_and_stops_that_make_no_sense():
    hinge = pendulum(0.0, 0.0, 0.0).joints[0]
    with pytest.raises(rj.SceneError, match="motion is 'angel'.*travel"):
        rj.JointSpring(hinge.a, hinge.b, 1.0, motion="angel")
    flat = rj.RigidBody("flat", 1.0, 1.0)
    with pytest.raises(rj.SceneError, match="motion is '1 of 2'"):
        rj.JointSpring(flat.at(), rj.ground.at(), 1.0, motion="1 of 2")
    with pytest.raises(rj.SceneError, match="motion is 'turn'"):
        rj.JointStop(flat.at(), rj.ground.at(), upper=1.0, motion="turn")
    with pytest.raises(rj.SceneError, match="lower is 2 and upper 1; give a lower limit below"):
        rj.JointStop(hinge.a, hinge.b, 2.0, 1.0)
    ball, origin = r.RigidBody("ball", 1.0, (1.0, 1.0, 1.0)), rj.ground.at((0.0, 0.0, 0.0))
    for ends, words in (
        ({"lower": 0.3}, "lower is 0.3, but it has no meaning.*leave it out"),
        ({"upper": 3.2}, "upper is 3.2, but the angle of a whole rotation goes from 0 to π"),
        ({"upper": -0.1}, "upper is -0.1"),
    ):
        with pytest.raises(rj.SceneError, match=words):
            rj.JointStop(ball.at(), origin, **ends, motion="turn")
    rj.JointStop(ball.at(), origin, upper=float(np.float32(np.pi)), motion="turn")
    with pytest.raises(rj.SceneError, match="it has no stop"):
        rj.JointStop(hinge.a, hinge.b)
    with pytest.raises(rj.SceneError, match="with friction: motion is 'any turn'"):
        rj.JointDamper(hinge.a, hinge.b, 1.0, rj.Friction(1.0), "any turn")


def test_a_coupling_is_a_polynomial():
    """A rack that a pinion drives, in the plane: residuals of poses."""
    wheel, rack = rj.RigidBody("wheel", 1.0, 1.0), rj.RigidBody("rack", 1.0, 1.0)
    ground = rj.ground.at()
    joint = rj.Coupling(
        rack.at(), wheel.at(), ground, ground, (0.5, 0.1, 2.0), motion_a="travel"
    )  # fmt: skip
    pose = [rj.Pose(jnp.array([x, 0.3]), jnp.array(turn)) for x, turn in ((1.2, 0.0), (0, 0.7))]
    still = rj.Pose(jnp.zeros(2), jnp.zeros(()))
    residual = joint.residual(0.0, *pose, still, still)
    assert_close(residual, [1.2 - (0.5 + 0.07 + 2 * 0.49)], IDENTITY)
