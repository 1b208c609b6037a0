"""Linear models against finite differences of runs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from comparison import assert_close
from tolerances import DIFFERENCED

import romjax as rj

TIME = 0.3  # [s]
STEP = 1e-4  # of the central differences
TS = jnp.linspace(0.0, TIME, 3)


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


@pytest.fixture(scope="module")
def model(system):
    push = rj.Force(rj.Marker("cart", (0.0, 0.0)), (1.0, 0.0), rj.Constant(1.0))
    return rj.linearize(system, {"push": push}, OUTPUTS)


def outputs(run) -> np.ndarray:
    q, v = run.q[-1], run.v[-1]
    return np.array([q[0], v[5], tip(0.0, q, v)])


def run(system, q=None, v=None):
    q, v = rj.consistent(system, q, v)
    return outputs(rj.simulate(system, TS, q0=q, v0=v, rtol=1e-12))


def test_names(model):
    assert model.inputs == ("push",)
    assert model.outputs == ("place", "speed", "tip")
    assert model.states == ("z1", "z2", "z1'", "z2'")


def test_states_and_outputs(system, model):
    """C exp(A t) is the derivative of the outputs by the start."""
    slope = np.asarray(model.C) @ scipy.linalg.expm(TIME * np.asarray(model.A))
    shapes = np.asarray(model.shapes)
    for i in range(2):
        change = STEP * shapes[:, i]
        by_q = run(system, system.q0 + change) - run(system, system.q0 - change)
        assert_close(by_q / (2 * STEP), slope[:, i], DIFFERENCED)
        by_v = run(system, None, change) - run(system, None, -change)
        assert_close(by_v / (2 * STEP), slope[:, 2 + i], DIFFERENCED)


def test_inputs(model):
    """A constant push, by the exponential of the model with the push as a state."""
    a, b = np.asarray(model.A), np.asarray(model.B)
    whole = np.block([[a, b], [np.zeros((1, 5))]])
    slope = np.asarray(model.C) @ scipy.linalg.expm(TIME * whole)[:4, 4:]
    more, less = (run(rj.assemble(cart(push))) for push in (STEP, -STEP))
    assert_close((more - less) / (2 * STEP), slope[:, 0], DIFFERENCED)
    assert_close(model.D, np.zeros((3, 1)), 0.0)


def test_frequency_response(model):
    omega = np.array([0.0, 3.0, 20.0])
    found = np.asarray(model.frequency_response(omega))
    assert found.shape == (3, 3, 1)
    # At rest the spring holds the push.
    assert_close(found[0, 0, 0], 1 / 30.0, 1e-9)
    unit = np.eye(4)
    for response, w in zip(found, omega, strict=True):
        by_hand = model.C @ np.linalg.inv(1j * w * unit - model.A) @ model.B
        assert_close(response, by_hand, 1e-12, scale=np.max(np.abs(by_hand)))


def test_a_generalized_force_is_an_input(system, model):
    def push(t, q, v):
        return jnp.zeros_like(q).at[0].set(1.0)

    other = rj.linearize(system, {"push": push}, ["cart.x"])
    assert_close(other.B, model.B, 1e-12)
    assert_close(other.C, model.C[:1], 1e-12)


@pytest.mark.slow
def test_the_slope_of_a_response():
    """Of the response at 3 rad/s with respect to the length of the arm."""

    @jax.jit
    def response(length):
        system = rj.assemble(cart(length=length))
        push = rj.Force(rj.Marker("cart", (0.0, 0.0)), (1.0, 0.0), rj.Constant(1.0))
        model = rj.linearize(system, {"push": push}, ["cart.x"])
        return jnp.abs(model.frequency_response(jnp.array([3.0]))[0, 0, 0])

    slope = (response(0.4 + STEP) - response(0.4 - STEP)) / (2 * STEP)
    assert_close(jax.grad(response)(0.4), slope, DIFFERENCED)
    assert_close(jax.jacfwd(response)(0.4), slope, DIFFERENCED)


@pytest.mark.slow
def test_full_and_reduced(system):
    """Minimal coordinates of all degrees of freedom: another basis, the same responses."""
    motion = rj.simulate(rj.assemble(cart(push=20.0)), jnp.linspace(0.0, 2.0, 101), rtol=1e-9)
    rom = rj.reduce(system, rj.pod(motion, rank=2), "minimal")
    rom = rom.starting_at(system.q0, system.v0)
    push = {"push": rj.Force(rj.Marker("cart", (0.0, 0.0)), (1.0, 0.0), rj.Constant(1.0))}
    omega = np.linspace(0.5, 20.0, 5)
    full, reduced = (
        rj.linearize(x, push, ["cart.x", "arm.phi'"]).frequency_response(omega)
        for x in (system, rom)
    )
    assert_close(reduced, full, 1e-9, scale=np.max(np.abs(full)))


def test_an_unknown_label(system):
    with pytest.raises(rj.InputError, match="cart.z"):
        rj.linearize(system, {}, ["cart.z"])
