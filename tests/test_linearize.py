"""Linear models against finite differences of runs."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import zoo
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.analysis.linearization import force_of

TIME = 0.3  # [s]
STEP = 1e-4  # of the central differences
TS = np.linspace(0.0, TIME, 3)


def cart(push=0.0, length=0.4) -> rj.Scene:
    """A cart on a rail and a spring, with a pendulum below it."""
    cart = rj.RigidBody("cart", 1.5, 0.1)
    arm = rj.RigidBody("arm", 0.5, 0.02, position=(0.0, -length), angle=-np.pi / 2)
    joints = [
        rj.Prismatic(cart.at(), rj.ground.at()),
        rj.Revolute(arm.at((-length, 0.0)), cart.at(), name="hinge"),
    ]
    effects = [
        rj.Gravity(),
        rj.Spring(cart.at(), rj.ground.at(), 30.0),
        rj.TorsionDamper(arm.at(), cart.at(), 0.05),
        rj.Force(cart.at(), (1.0, 0.0), rj.Constant(push)),
    ]
    return rj.Scene([cart, arm], joints, effects)


def tip(t, q, v):
    """The height of the end of the arm."""
    del t, v
    return q[4] + 0.4 * jnp.sin(q[5]) + 0.1 * q[3]


OUTPUTS = {"place": "cart.x", "speed": "arm.phi'", "tip": tip}


@pytest.fixture(scope="module")
def system():
    return rj.assemble(cart())


PUSH = rj.Force(rj.Marker("cart", (0.0, 0.0)), (1.0, 0.0), rj.Constant(1.0))


def pushed(t, q, v):
    """The same as a generalized force."""
    del t, v
    return jnp.zeros_like(q).at[0].set(1.0)


@pytest.fixture(scope="module")
def model(system):
    return rj.linearize(system, {"push": PUSH, "same": pushed}, OUTPUTS)


def run(system, change=0.0, rates=0.0):
    """Outputs at the end of a motion from a changed start, by the cart's place and the angle."""
    (x, angle), (speed, rate) = (
        (np.asarray(start) + by)[[0, 5]] for start, by in ((system.q0, change), (system.v0, rates))
    )
    along, up = 0.4 * np.cos(angle), 0.4 * np.sin(angle)
    q = [x, 0.0, 0.0, x + along, up, angle]
    v = [speed, 0.0, 0.0, speed - up * rate, along * rate, rate]
    motion = zoo.run(system, TS, q0=np.array(q), v0=np.array(v), rtol=1e-12)
    q, v = np.asarray(motion.q[-1]), np.asarray(motion.v[-1])
    return np.array([q[0], v[5], q[4] + 0.4 * np.sin(q[5]) + 0.1 * q[3]])


def test_names(model):
    assert model.inputs == ("push", "same")
    assert model.outputs == ("place", "speed", "tip")
    assert model.states == ("z1", "z2", "z1'", "z2'")


def test_states_and_outputs(system, model):
    """C exp(A t) is the derivative of the outputs by the start."""
    slope = np.asarray(model.C) @ scipy.linalg.expm(TIME * np.asarray(model.A))
    shapes = np.asarray(model.shapes)
    for i in range(2):
        change = STEP * shapes[:, i]
        by_q = run(system, change) - run(system, -change)
        assert_close(by_q / (2 * STEP), slope[:, i], DIFFERENCED)
        by_v = run(system, 0.0, change) - run(system, 0.0, -change)
        assert_close(by_v / (2 * STEP), slope[:, 2 + i], DIFFERENCED)


def test_inputs(model):
    """A constant push, by the exponential of the model with the push as a state."""
    a, b = np.asarray(model.A), np.asarray(model.B)[:, :1]
    assert_close(model.B[:, 1:], b, IDENTITY)
    whole = np.block([[a, b], [np.zeros((1, 5))]])
    slope = np.asarray(model.C) @ scipy.linalg.expm(TIME * whole)[:4, 4:]
    more, less = (run(rj.assemble(cart(push))) for push in (STEP, -STEP))
    assert_close((more - less) / (2 * STEP), slope[:, 0], DIFFERENCED)
    assert_close(model.D, np.zeros((3, 2)), 0.0)


def forces_of(system, inputs) -> np.ndarray:
    """The generalized forces that a linear model has as inputs."""
    at = 0.0, system.q0, system.v0
    return np.array(jax.jit(lambda: [force_of("linearize", system, x, *at) for x in inputs])())


def test_an_input_is_what_its_signal_changes(system):
    """Of a servo that is asked for an angle the gain, whatever its feedback does at the state."""
    ends = rj.Marker("arm", (-0.4, 0.0)), rj.Marker("cart", (0.0, 0.0))
    servo = {"gain": 20.0, "proportional": 20.0, "derivative": 2.0}
    inputs = [
        rj.Actuator(*ends, rj.Constant(1.0), **servo),
        rj.Torque(ends[0], rj.Constant(20.0)),
        rj.Torque(ends[1], rj.Constant(-20.0)),
    ]
    found, torque, back = forces_of(system, inputs)
    assert_close(found, torque + back, IDENTITY, scale=100.0)


def test_an_input_of_a_signal_that_changes_is_refused(system):
    """It is zero at the time of many a start. A sum of constants is one number."""

    def force(signal):
        acting = rj.Force(rj.Marker("cart", (0.0, 0.0)), (1.0, 0.0), signal)
        return force_of("export.c", system, acting, 0.0, system.q0, system.v0)

    words = r"^export.c: input Force.* follows a Sum.*Constant\(1\.0\)"
    with pytest.raises(rj.InputError, match=words):
        force(rj.Sum((rj.Constant(1.0), rj.Sine(1.0, 2.0))))
    along = system.structure.labels.index("cart.x")
    one = jax.jit(lambda: force(rj.Sum((rj.Constant(1.0),))))()
    assert_close(one, np.eye(system.n)[along], IDENTITY)


def test_inputs_that_count_turns_in_space():
    """Strength times speed is their power; they have no counter in the system."""
    angle, spin = 0.4, 0.7
    axis = {"axis": (1.0, 2.0, 2.0)}
    body = rj.spatial.RigidBody(
        "body",
        2.0,
        (0.3, 0.2, 0.1),
        orientation=rj.spatial.rotation(axis["axis"], angle),
        angular_velocity=spin * np.array([1.0, 2.0, 2.0]) / 3,
    )
    ends = body.at((0.0, 0.0, 0.0), **axis), rj.ground.at((0.0, 0.0, 0.0), **axis)
    system = rj.assemble(rj.Scene([body], [rj.Revolute(*ends)]))
    servo = {"proportional": 5.0, "derivative": 2.0}
    inputs = [
        rj.Actuator(*ends, rj.Constant(1.0), gain=3.0, **servo),
        rj.Motor(*ends, rj.Constant(1.0), **servo),
        rj.JointSpring(*ends, 6.0),
        rj.TorsionSpring(*ends, 7.0),
    ]
    powers = forces_of(system, inputs) @ np.asarray(system.v0)
    strengths = np.array([3.0, 5.0, -6.0 * angle, -7.0 * angle])
    assert_close(powers, spin * strengths, IDENTITY, scale=10.0)


def test_frequency_response(model):
    omega = np.array([0.0, 3.0, 20.0])
    found = np.asarray(model.frequency_response(omega))
    assert found.shape == (3, 3, 2)
    # At rest the spring holds the push.
    assert_close(found[0, 0, 0], 1 / 30.0, 1e-9)
    a, b, c, unit = *map(np.asarray, (model.A, model.B, model.C)), np.eye(4)
    for response, w in zip(found, omega, strict=True):
        by_hand = c @ np.linalg.inv(1j * w * unit - a) @ b
        assert_close(response, by_hand, 1e-12, scale=np.max(np.abs(by_hand)))


@jax.jit
@jax.value_and_grad
def response(length):
    """Of the place to a push at 3 rad/s."""
    model = rj.linearize(rj.assemble(cart(length=length)), {"push": PUSH}, ["cart.x"])
    return jnp.abs(model.frequency_response(jnp.array([3.0]))[0, 0, 0])


@pytest.mark.slow
def test_the_slope_of_a_response():
    """By the length of the arm, backwards; forwards too goes that of a frequency, in test_modes."""
    slope = (response(0.4 + STEP)[0] - response(0.4 - STEP)[0]) / (2 * STEP)
    assert_close(response(0.4)[1], slope, DIFFERENCED)


@pytest.mark.slow
def test_full_and_reduced(system, model):
    """Minimal coordinates of all degrees of freedom: another basis, the same responses."""
    motion = zoo.run(rj.assemble(cart(push=20.0)), np.linspace(0.0, 2.0, 101))
    rom = rj.reduce(system, rj.pod(motion, rank=2), "minimal")
    rom = rom.starting_at(system.q0, system.v0)
    omega = np.linspace(0.5, 20.0, 5)
    reduced = rj.linearize(rom, {"push": PUSH, "same": pushed}, OUTPUTS)
    full, reduced = (np.asarray(x.frequency_response(omega)) for x in (model, reduced))
    assert_close(reduced, full, 1e-9, scale=np.max(np.abs(full)))


def test_an_unknown_label(system):
    with pytest.raises(rj.InputError, match="cart.z"):
        rj.linearize(system, {}, ["cart.z"])


def felt(system, t, q, v):
    """The acceleration of the cart."""
    return system.acceleration(t, q, v)[0][0]


@pytest.mark.parametrize("verb", ["linearize", "export.c"])
def test_accelerations_that_inputs_change_are_refused(system, verb, tmp_path):
    """A function of (t, q, v) does not know the push, so that it has none of its row of D."""
    given = {"push": PUSH}, {"felt": functools.partial(felt, system)}
    ask = rj.linearize if verb == "linearize" else functools.partial(into, tmp_path)
    with pytest.raises(rj.InputError, match=rf"{verb}: an output asks for accelerations"):
        ask(system, *given)


def into(path, system, inputs, outputs):
    return rj.export.c(system, path, inputs=inputs, outputs=outputs)


def test_accelerations_without_inputs(system):
    """They are rates of speeds, whose rows of C they have along A."""
    outputs = {"felt": functools.partial(felt, system), "speed": "cart.x'"}
    model = rj.linearize(system, {}, outputs)
    assert_close(model.C[0], model.C[1] @ model.A, SOLVED, np.max(np.abs(model.A)))
