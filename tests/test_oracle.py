"""The chapter's example against a model written by hand in independent coordinates."""

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import zoo
from comparison import assert_close
from programs import kept
from tolerances import IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj
from romjax.system import dynamics

CART, PENDULUM, LENGTH = 1.0, 0.004, 0.8  # [kg], [kg], [m]
STIFFNESS, DAMPING, LOAD, FREQUENCY = 100.0, 0.1, 10.0, 10.0  # [N/m], [N s/m], [N], [Hz]
MODES = 2 * np.pi * np.array([16.0, 1000.0])  # [rad/s]
SHAPES = 2 / np.sqrt(PENDULUM) * np.array([1.0, -1.0])  # of the modes at the hinge [kg^-½]
INERTIA = PENDULUM * LENGTH**2 / 12
ALONG = np.array([1.0, 1.0]) / np.sqrt(2)  # the rail
ARM = LENGTH / 2  # from the centre of mass to the hinge


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def carried(x, v):
    """Ṙ = B v and R̈ = B v̇ + b of the pendulum's frame R = s e − A(φ) (σ, h), where σ = Σ s_k q_k
    is the deflection at the hinge; x = (s, φ, q₁, q₂).
    """
    turn, bent, bending = rotation(x[1]), SHAPES @ x[2:], SHAPES @ v[2:]
    columns = [ALONG, -turn @ [-ARM, bent], *(-shape * turn[:, 0] for shape in SHAPES)]
    drift = v[1] ** 2 * turn @ [bent, ARM] - 2 * v[1] * bending * turn[:, 1]
    return np.stack(columns, axis=1), drift


def mass(x):
    base, _ = carried(x, np.zeros(4))
    own = np.diag([CART, INERTIA + x[2:] @ x[2:], 1.0, 1.0])
    return own + PENDULUM * base.T @ base


def acceleration(t, x, v):
    base, drift = carried(x, v)
    force = -PENDULUM * base.T @ drift
    force[0] += LOAD * np.sin(2 * np.pi * FREQUENCY * t) - STIFFNESS * x[0] - DAMPING * v[0]
    force[1] -= 2 * v[1] * x[2:] @ v[2:]
    force[2:] += (v[1] ** 2 - MODES**2) * x[2:]
    return np.linalg.solve(mass(x), force)


def redundant(x, v):
    """The eight coordinates and velocities of the two bodies."""
    base, _ = carried(x, v)
    cart, frame = x[0] * ALONG, x[0] * ALONG - rotation(x[1]) @ [SHAPES @ x[2:], ARM]
    return (
        np.concatenate([cart, [0.0], frame, x[1:]]),
        np.concatenate([v[0] * ALONG, [0.0], base @ v, v[1:]]),
    )


@kept
def rates(system, *state):
    return system.acceleration(*state)[0]


@kept
def stiffness(system):
    """−∂a/∂q at the start."""
    return -dynamics.linearize(system, 0.0, system.q0, system.v0).by_position


def test_acceleration():
    """At states of large motion, without integration."""
    system = rj.assemble(rj.gallery.cart_pendulum())
    rng = np.random.default_rng(16)
    for t in (0.0, 0.13, 0.4):
        x, v = rng.normal(size=(2, 4)) * np.array([1.0, 1.0, 0.01, 0.01])
        q, rate = redundant(x, v)
        found = rates(system, np.asarray(t), q, rate)
        a = acceleration(t, x, v)
        wanted = np.array([a[0] / np.sqrt(2), a[0] / np.sqrt(2), 0.0, *a[1:]])
        terms = (
            np.abs(np.linalg.inv(mass(x)))
            @ np.abs(MODES[1] ** 2 * x[2:]).sum(keepdims=True)[[0, 0, 0, 0]]
        )
        assert_close(np.asarray(found)[[0, 1, 2, 5, 6, 7]], wanted, IDENTITY, np.max(terms))


@pytest.fixture(scope="module")
def truth():
    return zoo.motion(zoo.cart_pendulum)


@pytest.fixture(scope="module")
def oracle(truth):
    """Two periods of the load, by an explicit method of order 8 at a tenth of the tolerance."""
    solution = scipy.integrate.solve_ivp(
        lambda t, y: np.concatenate([y[4:], acceleration(t, y[:4], y[4:])]),
        (0.0, 0.2),
        np.zeros(8),
        method="DOP853",
        t_eval=np.asarray(truth.t)[:21],
        rtol=TIGHT / 10,
        atol=TIGHT / 100,
    )
    assert solution.success
    states = [redundant(y[:4], y[4:]) for y in solution.y.T]
    return np.array([q for q, _ in states]), np.array([v for _, v in states])


def test_motion(truth, oracle):
    """‖M₀^½ (q̃ − q)‖ / ‖M₀^½ (q − q₀)‖ over two periods of the load (measured: 4e-12)."""
    assert error(truth.q, oracle[0], truth.metric) <= SOLVED


def test_velocities(truth, oracle):
    """The same of the velocities, where the second mode's 1000 Hz count against the load's 10 Hz
    (measured: 2e-9).
    """
    faster = MODES[1] / (2 * np.pi * FREQUENCY)
    assert error(truth.v, oracle[1], truth.metric) <= faster * SOLVED


def error(found, wanted, metric):
    found = np.asarray(found)[: len(wanted)]
    weight = np.sqrt(np.diag(metric))
    moved = np.linalg.norm((wanted - wanted[0]) * weight)
    return np.linalg.norm((found - wanted) * weight) / moved


def test_drift(truth):
    """The constraints hold over one second."""
    assert_close(truth.violation, 0.0, SOLVED)


def test_natural_frequencies_of_a_free_beam():
    """ω = (βL)² √(EI / m L³), and three rigid motions without stiffness."""
    body = rj.Beam("beam", 0.7, 1.3, EI=5.0, modes=3, shapes="free-free")
    system = rj.assemble(rj.Scene([body]))
    roots = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671])
    wanted = np.concatenate([np.zeros(3), roots**4 * 5.0 / (0.7 * 1.3**3)])
    found = np.sort(np.linalg.eigvalsh(stiffness(system)))
    assert_close(found, wanted, IDENTITY, wanted[-1])


def test_natural_frequencies_of_the_chapters_example():
    """Of the mechanism at rest: the redundant model has those of the independent coordinates, and
    four zeros for its four constraints.
    """
    system = rj.assemble(rj.gallery.cart_pendulum())
    springs = np.diag([STIFFNESS, 0.0, *MODES**2])
    wanted = scipy.linalg.eigh(springs, mass(np.zeros(4)), eigvals_only=True)
    found = np.sort(np.linalg.eigvals(stiffness(system)).real)[-4:]
    assert_close(found, np.sort(wanted), IDENTITY, wanted[-1])
