"""Identities of mechanics on random states. Nothing is integrated here, and nothing is stored."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import mechanics
import numpy as np
import pytest
from comparison import assert_close
from programs import kept
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.system import dynamics
from romjax.system.constraints import right_hand_side

STATES = 6
TIME = 0.37  # [s] between two entries of the table of forces
STABILIZATION = rj.Baumgarte(alpha=10.0, beta=25.0)
# Step of central differences of order four.
STEP = 1e-3


def assert_agree(actual, wanted, size=None, tol=IDENTITY):
    """Assert that two arrays agree, relative to the size of the terms."""
    assert_close(actual, wanted, tol, np.max(np.abs(wanted)) if size is None else size)


def gamma_of(system, t, q, v, stabilization=None):
    """γ of C_q a = γ."""
    return right_hand_side(system.constraint, system.m, t, q, v, stabilization)


def everything(scene, system, q, v, a):
    """All that the tests compare, found and written a second time, in one program."""
    jacobian = dynamics.jacobian(system, TIME, q)
    state = dynamics.constraint_state(system, TIME, q, v)

    def energy(q, v):
        kinetic = mechanics.kinetic_energy(scene, q, v)
        return kinetic + mechanics.potential_energy(scene, q), kinetic

    (_, kinetic), (rate, _) = jax.jvp(energy, (q, v), (v, a))
    return {
        "kinetic": (dynamics.kinetic_energy(system, q, v), kinetic),
        "power": (rate, mechanics.power(scene, TIME, q, v)),
        "mass": system.mass(q),
        "force": system.force(TIME, q, v),
        "gamma": gamma_of(system, TIME, q, v, STABILIZATION),
        "jacobian": (jacobian, jax.jacfwd(system.constraint, argnums=1)(TIME, q)),
        "constraint": (state.violation, state.rate),
    }


@kept
def pulled(system, q, v):
    """Accelerations and multipliers in several states."""
    return jax.vmap(lambda *state: system.acceleration(TIME, *state, STABILIZATION))(q, v)


@functools.cache
def mixed():
    """The scene, whose numbers are none of a program's arguments: NumPy computes with them."""
    return mechanics.mixed_scene()


@kept
def compared(system, q, v, a):
    """`everything` in several states."""
    return jax.vmap(lambda *state: everything(mixed(), system, *state))(q, v, a)


class Case:
    """Random states of a scene of all kinds, any ones and ones that fit the joints, and what was
    found at them: at any ones first.
    """

    def __init__(self):
        self.system = rj.assemble(mixed())
        rng = np.random.default_rng(39)
        moved, v = rng.normal(size=(2, STATES, self.system.n))
        q = np.asarray(self.system.q0) + 0.1 * moved
        fitting = [rj.consistent(self.system, *state) for state in zip(q, v, strict=True)]
        self.q, self.v = (
            np.concatenate([any_one, fits])
            for any_one, fits in zip((q, v), zip(*fitting, strict=True), strict=True)
        )
        both = pulled(self.system, self.q, self.v)
        found = compared(self.system, self.q, self.v, both[0]) | {"pulled": both}
        self.found = jax.tree.map(np.asarray, found)


@pytest.fixture(scope="module")
def case() -> Case:
    return Case()


def times(matrix, vector):
    """The products of matrices with vectors, at all states."""
    return np.einsum("kij,kj->ki", matrix, vector)


def turned_over(matrix):
    return np.swapaxes(matrix, 1, 2)


def test_kinetic_energy_is_that_of_the_material_points(case):
    """½ vᵀ M v = ½ Σ m |ṙ|²; for beams the sum is a quadrature along the axis, exact for modes
    that are orthonormal and orthogonal to rigid motion.
    """
    assert_agree(*case.found["kinetic"])


def test_power_balance(case):
    """d(T + V)/dt = power of the loads less that of the dampers, along the acceleration."""
    rate, power = case.found["power"]
    reaction = times(turned_over(case.found["jacobian"][0]), case.found["pulled"][1])
    size = np.sum(np.abs(case.v) * (np.abs(case.found["force"]) + np.abs(reaction)), axis=1)
    fits = slice(STATES, None)
    assert_agree(rate[fits], power[fits], size[fits])


def test_joints_do_no_work(case):
    """C_q v = 0 on consistent states, and the constraints hold."""
    violation, rate = (x[STATES:] for x in case.found["constraint"])
    assert_close(violation, 0.0, IDENTITY)
    assert_close(rate, 0.0, IDENTITY, np.max(np.abs(case.v)))


def test_equation_of_motion(case):
    """M a + C_qᵀ λ = Q and C_q a = γ, off the constraints too."""
    (a, multipliers), mass = case.found["pulled"], case.found["mass"]
    jacobian, force, gamma = case.found["jacobian"][0], case.found["force"], case.found["gamma"]
    reaction = times(turned_over(jacobian), multipliers)
    terms = times(np.abs(mass), np.abs(a)) + np.abs(force)
    terms += times(np.abs(turned_over(jacobian)), np.abs(multipliers))
    rows = times(np.abs(jacobian), np.abs(a)) + np.abs(gamma)
    most = {"axis": 1, "keepdims": True}
    assert_agree(times(mass, a) + reaction - force, 0.0, np.max(terms, **most))
    assert_agree(times(jacobian, a) - gamma, 0.0, np.max(rows, **most))


def test_mass_matrix_is_symmetric_positive_definite(case):
    mass = case.found["mass"]
    assert_agree(mass, turned_over(mass))
    assert np.all(np.linalg.eigvalsh(mass) > 0)


def test_jacobian_is_the_derivative_of_the_constraints(case):
    assert_agree(*case.found["jacobian"])


@kept
def linearized(system, states):
    """The acceleration in several states, and its derivatives."""
    n = system.n

    def at(x):
        return dynamics.linearize(system, x[-1], x[:n], x[n:-1], STABILIZATION)

    return jax.vmap(at)(states)


@kept
def accelerated(system, states):
    n = system.n

    def at(x):
        return system.acceleration(x[-1], x[:n], x[n:-1], STABILIZATION)[0]

    return jax.vmap(at)(states)


@pytest.mark.slow
def test_linearization_is_the_derivative_of_the_acceleration(cart_pendulum):
    """a, ∂a/∂q, ∂a/∂v and ∂a/∂t off the constraints, against differences of the acceleration in
    each direction.
    """
    system, n = cart_pendulum, cart_pendulum.n

    states = np.random.default_rng(40).normal(size=(STATES, 2 * n + 1))
    states[:, :n] = np.asarray(system.q0)[None] + 0.1 * states[:, :n]
    states[:, -1] = TIME

    def moved(step):
        x = states[:, None] + step * np.eye(2 * n + 1)[None]
        found = accelerated(system, x.reshape(-1, 2 * n + 1))
        return np.asarray(found).reshape(STATES, 2 * n + 1, n)

    near, far = ((moved(h) - moved(-h)) / (2 * h) for h in (STEP, 2 * STEP))
    wanted = turned_over((4 * near - far) / 3)
    a, *slopes = map(np.asarray, linearized(system, states))
    assert_agree(a, np.asarray(accelerated(system, states)))
    for found, place in zip(slopes, (np.s_[:n], np.s_[n:-1], -1), strict=True):
        assert_agree(found, wanted[..., place], tol=DIFFERENCED)


def test_quadratic_velocity_force_is_that_of_lagrange():
    """−Ṁ v + ½ ∂(vᵀ M v)/∂q = −d/dt(∂T/∂v) + ∂T/∂q at a = 0, for a full matrix."""

    def mass(q):
        arms = jnp.stack([jnp.ones(3), jnp.cos(q), q * q])
        return jnp.eye(3) + arms.T @ arms

    def kinetic(q, v):
        return 0.5 * v @ mass(q) @ v

    @jax.jit
    def both(q, v):
        momentum_rate = jax.jvp(lambda q: jax.grad(kinetic, argnums=1)(q, v), (q,), (v,))[1]
        wanted = jax.grad(kinetic)(q, v) - momentum_rate
        return rj.quadratic_velocity_force(mass)(q, v), wanted

    assert_agree(*both(*np.random.default_rng(1).normal(size=(2, 3))))


def test_moving_constraints():
    """γ = −(C_q v)_q v − 2 C_qt v − C_tt − α Ċ − β C, with every derivative taken by hand."""
    turn, speed = 1.7, 0.9  # [rad/s], [m/s²]

    def constraint(t, q):
        x, y, z = q
        c, s = jnp.cos(turn * t), jnp.sin(turn * t)
        return jnp.stack([x * c + y * s - 0.5 * speed * t**2, x**2 * y - t * z])

    system = rj.CustomSystem(
        lambda q: jnp.eye(3), lambda t, q, v: -q, constraint, q0=[1.0, 0.0, 0.0], v0=np.zeros(3)
    )
    t = 0.6
    (x, y, z), (vx, vy, vz) = q, v = np.random.default_rng(2).normal(size=(2, 3))
    c, s = np.cos(turn * t), np.sin(turn * t)
    rate = np.array(
        [
            vx * c + vy * s + turn * (y * c - x * s) - speed * t,
            2 * x * y * vx + x**2 * vy - t * vz - z,
        ]
    )
    curvature = np.array([0.0, 2 * y * vx**2 + 4 * x * vx * vy])
    mixed = np.array([turn * (vy * c - vx * s), -vz])  # C_qt v
    explicit = np.array([-(turn**2) * (x * c + y * s) - speed, 0.0])  # C_tt
    wanted = -curvature - 2 * mixed - explicit

    @jax.jit
    def evaluate(q, v):
        a, _ = system.acceleration(t, q, v)
        gammas = gamma_of(system, t, q, v), gamma_of(system, t, q, v, STABILIZATION)
        return gammas, dynamics.constraint_state(system, t, q, v, a)

    (free, pulled), state = evaluate(q, v)
    violation = np.array([x * c + y * s - 0.5 * speed * t**2, x**2 * y - t * z])
    pull = 10.0 * rate + 25.0 * violation
    assert_agree(free, wanted)
    assert_agree(pulled, wanted - pull)
    assert_agree(state.rate, rate)
    assert_agree(state.curvature, 0.0, np.max(np.abs(wanted)))


def test_a_hinge_made_twice_changes_nothing():
    """Redundant constraints: the same acceleration, and the multipliers of least norm share the
    load.
    """
    once = rj.gallery.chain(2)
    twice = rj.Scene(once.bodies, (*once.joints[:1], *once.joints), once.effects)
    q, v = np.array([[0.5, 0, 0, 1.5, 0, 0], [0, 0.5, 1, 0, 1.5, 1]])
    (a, multipliers), (b, shared) = (
        map(np.asarray, eqx.filter_jit(rj.assemble(scene).acceleration)(0.0, q, v))
        for scene in (once, twice)
    )
    assert_agree(b, a)
    halves = np.concatenate([multipliers[:2] / 2, multipliers[:2] / 2, multipliers[2:]])
    assert_close(shared, halves, SOLVED, np.max(np.abs(halves)))
