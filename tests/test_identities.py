"""Identities of mechanics on random states. Nothing is integrated here, and nothing is stored."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import mechanics
import pytest
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax.system import dynamics
from romjax.system.constraints import right_hand_side

SCENES = {
    "cart_pendulum": rj.gallery.cart_pendulum,
    "mixed": mechanics.mixed_scene,
}
STATES = 6
TIME = 0.37  # [s] between two entries of the table of forces
STABILIZATION = rj.Baumgarte(alpha=10.0, beta=25.0)


class Case:
    """A scene, its system, and random states of it: any ones, and ones that fit the joints."""

    def __init__(self, make):
        self.scene = make()
        self.system = rj.assemble(self.scene)
        keys = jax.random.split(jax.random.key(39), 2)
        shape = (STATES, self.system.n)
        self.q = self.system.q0[None] + 0.1 * jax.random.normal(keys[0], shape)
        self.v = jax.random.normal(keys[1], shape)
        fitting = [rj.consistent(self.system, q, v) for q, v in zip(self.q, self.v, strict=True)]
        self.fitting = tuple(jnp.stack(x) for x in zip(*fitting, strict=True))


@pytest.fixture(scope="module", params=list(SCENES))
def case(request) -> Case:
    return Case(SCENES[request.param])


def on_all(function, *states):
    """`function` of each state."""
    return jax.jit(jax.vmap(function))(*states)


def assert_agree(actual, wanted, size=None):
    """Assert that two arrays agree to IDENTITY, relative to the size of the terms."""
    assert_close(actual, wanted, IDENTITY, jnp.max(jnp.abs(wanted)) if size is None else size)


def gamma_of(system, t, q, v, stabilization=None):
    """γ of C_q a = γ."""
    return right_hand_side(system.constraint, system.m, t, q, v, stabilization)


def test_kinetic_energy_is_that_of_the_material_points(case):
    """½ vᵀ M v = ½ Σ m |ṙ|²; for beams the sum is a quadrature along the axis, exact for modes
    that are orthonormal and orthogonal to rigid motion.
    """
    found = on_all(functools.partial(dynamics.kinetic_energy, case.system), case.q, case.v)
    wanted = on_all(lambda q, v: mechanics.kinetic_energy(case.scene, q, v), case.q, case.v)
    assert_agree(found, wanted)


def test_power_balance(case):
    """d(T + V)/dt = power of the loads less that of the dampers, along the acceleration."""

    def balance(q, v):
        a, multipliers = case.system.acceleration(TIME, q, v)

        def energy(q, v):
            kinetic = mechanics.kinetic_energy(case.scene, q, v)
            return kinetic + mechanics.potential_energy(case.scene, q)

        rate = jax.jvp(energy, (q, v), (v, a))[1]
        reaction = dynamics.jacobian(case.system, TIME, q).T @ multipliers
        terms = jnp.abs(case.system.force(TIME, q, v)) + jnp.abs(reaction)
        return rate, mechanics.power(case.scene, TIME, q, v), jnp.abs(v) @ terms

    rate, power, size = on_all(balance, *case.fitting)
    assert_agree(rate, power, size)


def test_joints_do_no_work(case):
    """C_q v = 0 on consistent states, and the constraints hold."""
    state = on_all(lambda q, v: dynamics.constraint_state(case.system, TIME, q, v), *case.fitting)
    assert_close(state.violation, 0.0, IDENTITY)
    assert_close(state.rate, 0.0, IDENTITY, jnp.max(jnp.abs(case.v)))


def test_equation_of_motion(case):
    """M a + C_qᵀ λ = Q and C_q a = γ, off the constraints too."""

    def residuals(q, v):
        system = case.system
        a, multipliers = system.acceleration(TIME, q, v, STABILIZATION)
        mass, jacobian = system.mass(q), dynamics.jacobian(system, TIME, q)
        force, gamma = system.force(TIME, q, v), gamma_of(system, TIME, q, v, STABILIZATION)
        motion = mass @ a + jacobian.T @ multipliers - force
        terms = jnp.abs(mass) @ jnp.abs(a) + jnp.abs(jacobian.T) @ jnp.abs(multipliers)
        rows = jnp.abs(jacobian) @ jnp.abs(a) + jnp.abs(gamma)
        return motion, jnp.max(terms + jnp.abs(force)), jacobian @ a - gamma, jnp.max(rows)

    motion, terms, constraint, rows = on_all(residuals, case.q, case.v)
    assert_agree(motion, 0.0, terms[:, None])
    assert_agree(constraint, 0.0, rows[:, None])


def test_mass_matrix_is_symmetric_positive_definite(case):
    mass = on_all(case.system.mass, case.q)
    assert_agree(mass, jnp.swapaxes(mass, 1, 2))
    assert jnp.all(jnp.linalg.eigvalsh(mass) > 0)


def test_jacobian_is_the_derivative_of_the_constraints(case):
    found = on_all(lambda q: dynamics.jacobian(case.system, TIME, q), case.q)
    wanted = on_all(lambda q: jax.jacfwd(case.system.constraint, argnums=1)(TIME, q), case.q)
    assert_agree(found, wanted)


def test_linearization_is_the_derivative_of_the_acceleration(case):
    """a, ∂a/∂q, ∂a/∂v and ∂a/∂t, against derivatives through the solve."""

    def acceleration(t, q, v):
        return case.system.acceleration(t, q, v, STABILIZATION)[0]

    def both(q, v):
        time = jnp.asarray(TIME)
        slopes = jax.jacfwd(acceleration, argnums=(1, 2, 0))(time, q, v)
        wanted = (acceleration(time, q, v), *slopes)
        return dynamics.linearize(case.system, time, q, v, STABILIZATION), wanted

    for found, wanted in zip(*on_all(both, case.q, case.v), strict=True):
        assert_agree(found, wanted)


def test_quadratic_velocity_force_is_that_of_lagrange():
    """−Ṁ v + ½ ∂(vᵀ M v)/∂q = −d/dt(∂T/∂v) + ∂T/∂q at a = 0, for a full matrix."""

    def mass(q):
        arms = jnp.stack([jnp.ones(3), jnp.cos(q), q * q])
        return jnp.eye(3) + arms.T @ arms

    def kinetic(q, v):
        return 0.5 * v @ mass(q) @ v

    q, v = jax.random.normal(jax.random.key(1), (2, 3))
    momentum_rate = jax.jvp(lambda q: jax.grad(kinetic, argnums=1)(q, v), (q,), (v,))[1]
    wanted = jax.grad(kinetic)(q, v) - momentum_rate
    assert_agree(rj.quadratic_velocity_force(mass)(q, v), wanted)


def test_moving_constraints():
    """γ = −(C_q v)_q v − 2 C_qt v − C_tt − α Ċ − β C, with every derivative taken by hand."""
    turn, speed = 1.7, 0.9  # [rad/s], [m/s²]

    def constraint(t, q):
        x, y, z = q
        c, s = jnp.cos(turn * t), jnp.sin(turn * t)
        return jnp.stack([x * c + y * s - 0.5 * speed * t**2, x**2 * y - t * z])

    system = rj.CustomSystem(
        lambda q: jnp.eye(3), lambda t, q, v: -q, constraint, q0=[1.0, 0.0, 0.0], v0=jnp.zeros(3)
    )
    t = 0.6
    (x, y, z), (vx, vy, vz) = q, v = jax.random.normal(jax.random.key(2), (2, 3))
    c, s = jnp.cos(turn * t), jnp.sin(turn * t)
    rate = jnp.stack(
        [
            vx * c + vy * s + turn * (y * c - x * s) - speed * t,
            2 * x * y * vx + x**2 * vy - t * vz - z,
        ]
    )
    curvature = jnp.stack([jnp.zeros(()), 2 * y * vx**2 + 4 * x * vx * vy])
    mixed = jnp.stack([turn * (vy * c - vx * s), -vz])  # C_qt v
    explicit = jnp.stack([-(turn**2) * (x * c + y * s) - speed, jnp.zeros(())])  # C_tt
    wanted = -curvature - 2 * mixed - explicit

    @jax.jit
    def evaluate(q, v):
        a, _ = system.acceleration(t, q, v)
        gammas = gamma_of(system, t, q, v), gamma_of(system, t, q, v, STABILIZATION)
        return gammas, dynamics.constraint_state(system, t, q, v, a)

    (free, pulled), state = evaluate(q, v)
    pull = STABILIZATION.alpha * rate + STABILIZATION.beta * constraint(t, q)
    assert_agree(free, wanted)
    assert_agree(pulled, wanted - pull)
    assert_agree(state.rate, rate)
    assert_agree(state.curvature, 0.0, jnp.max(jnp.abs(wanted)))


def test_a_hinge_made_twice_changes_nothing():
    """Redundant constraints: the same acceleration, and the multipliers of least norm share the
    load.
    """
    once = rj.gallery.chain(2)
    twice = rj.Scene(once.bodies, (*once.joints[:1], *once.joints), once.effects)
    q, v = jnp.array([0.5, 0, 0, 1.5, 0, 0]), jnp.array([0, 0.5, 1, 0, 1.5, 1])
    (a, multipliers), (b, shared) = (
        eqx.filter_jit(rj.assemble(scene).acceleration)(0.0, q, v) for scene in (once, twice)
    )
    assert_agree(b, a)
    halves = jnp.concatenate([multipliers[:2] / 2, multipliers[:2] / 2, multipliers[2:]])
    assert_close(shared, halves, SOLVED, jnp.max(jnp.abs(halves)))
