"""Hard cases, each with what a naive solver makes of it: redundant and vanishing constraints,
extreme masses, stiffness, single precision.
"""

import dataclasses
from fractions import Fraction

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import RK4, ends, linkage
from tolerances import IDENTITY
from zoo import cart_pendulum, four_bar, run, unit_mass
from zoo import motion as shared

import romjax as rj
from romjax.system import dynamics

# Required figures, case by case.
ANGLE, ENERGY = 1e-8, 1e-9  # through a change point that a step lands on
PASSING = 1e-5  # through a bifurcation, with steps of 0.01 s
LIMIT = 1e-9  # the acceleration at a singular position
MASS = {-8: 1e-6, -4: 1e-10, 4: 1e-10, 8: 1e-6}  # by the exponent of the mass ratio
STIFF_ERROR, STIFF_STEPS = 1e-5, 1500
SINGLE = 1e-5  # in single precision


def kinetic(motion: rj.Trajectory) -> np.ndarray:
    """½ vᵀ M v, of bodies with constant mass."""
    return 0.5 * np.einsum("ki,ij,kj->k", motion.v, motion.metric, motion.v)


def moving(system):
    """A consistent state in motion."""
    return rj.consistent(system, system.q0, system.v0 + 0.3 * np.arange(system.n))


@eqx.filter_jit
def extended(system, q, v):
    """Mass matrix, Jacobian and right-hand side of the extended system."""
    rows, gamma = dynamics.jacobian(system, 0.0, q), dynamics.gamma(system, 0.0, q, v)
    return system.mass(q), rows, jnp.concatenate([system.force(0.0, q, v), gamma])


@eqx.filter_jit
def solved(system, q, v):
    """q̈ and λ, as simulations find them."""
    return system.acceleration(0.0, q, v)


def solved_exactly(system, q, v) -> tuple[np.ndarray, np.ndarray]:
    """q̈ and λ of the extended system, by Gauss's elimination in rational arithmetic."""
    n, m = system.n, system.m
    mass, rows, right = map(np.asarray, extended(system, q, v))
    matrix = np.block([[mass, rows.T], [rows, np.zeros((m, m))]])
    table = [[Fraction(float(x)) for x in (*row, b)] for row, b in zip(matrix, right, strict=True)]
    for i in range(n + m):
        pivot = max(range(i, n + m), key=lambda r, i=i: abs(table[r][i]))
        table[i], table[pivot] = table[pivot], table[i]
        table[i] = [x / table[i][i] for x in table[i]]
        for r in range(n + m):
            if r != i and table[r][i]:
                factor = table[r][i]
                table[r] = [x - factor * y for x, y in zip(table[r], table[i], strict=True)]
    solution = np.array([float(row[-1]) for row in table])
    return solution[:n], solution[n:]


@pytest.mark.slow
def test_a_pin_made_twice():
    """LU and Cholesky of the extended matrix give NaN. Here the acceleration is right to 1e-12
    and both pins carry one half: the shortest multipliers.
    """
    once, twice = rj.assemble(four_bar()), rj.assemble(four_bar(doubled=True))
    q, v = moving(once)
    wanted, forces = solved_exactly(once, q, v)
    a, multipliers = map(np.asarray, solved(twice, q, v))
    assert np.max(np.abs(a - wanted)) <= IDENTITY
    halves = np.concatenate([forces[:2] / 2, forces[2:], forces[:2] / 2])
    assert np.max(np.abs(multipliers - halves)) <= IDENTITY * np.max(np.abs(forces))


@pytest.mark.parametrize("exponent", MASS)
def test_a_heavy_or_light_coupler(exponent):
    """Masses that differ by 10^k, against rational arithmetic. Three fixed proximal sweeps
    reach 5e-5 at k = 8; here they go on until the residual is at rounding.
    """
    system = rj.assemble(four_bar(10.0**exponent))
    q, v = moving(system)
    wanted, _ = solved_exactly(system, q, v)
    a, _ = solved(system, q, v)
    assert np.max(np.abs(a - wanted)) <= MASS[exponent] * np.max(np.abs(wanted))


@pytest.mark.parametrize(
    "keep",
    [None, pytest.param(rj.Projection(), marks=pytest.mark.slow)],
    ids=["unstabilised", "projected"],
)
def test_a_step_that_lands_on_a_change_point(keep):
    """A parallelogram with cranks of 1 m on a base of 2 m turns at π/2 rad/s; every hundredth
    step of 0.01 s lands where all bars are in line and the constraints lose rank. LU gives NaN.
    """
    w = np.pi / 2
    points = {"A": (0, 0), "b": (0, 1), "c": (2, 1), "D": (2, 0)}
    bars = [("A", "b"), ("b", "c"), ("D", "c")]
    system = rj.assemble(linkage(points, bars, {"b": (-w, 0), "c": (-w, 0)}))
    ts = np.linspace(0.0, 8.0, 81)
    motion = run(system, ts, solver=RK4(), dt=0.01, stabilization=keep)
    assert np.max(np.abs(motion.q[:, 2] - (np.pi / 2 + w * ts))) <= ANGLE
    energy = kinetic(motion)
    assert np.max(np.abs(energy / energy[0] - 1)) <= ENERGY


def slider_crank(angle) -> rj.Scene:
    """Crank and rod of 1 m, a slider of 1 kg; at 90° the slider may stay where it is and the rod
    turn with the crank. Turning at 1 rad/s.
    """
    c, s = np.cos(angle), np.sin(angle)
    points = {"O": (0, 0), "p": (c, s), "s": (2 * c, 0)}
    velocities = {"p": (-s, c), "s": (-2 * s, 0)}
    bars = linkage(points, [("O", "p"), ("p", "s")], velocities)
    slider = rj.RigidBody("slider", 1.0, 1.0, position=points["s"], velocity=velocities["s"])
    joints = [
        *bars.joints,
        rj.Revolute(ends(bars.bodies[1])[1], slider.at()),
        rj.PointOnLine(slider.at(), rj.ground.at()),
        rj.FixedAngle(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([*bars.bodies, slider], joints)


def slider_crank_places(angle):
    """All coordinates on the branch that slides."""
    c, s, none = jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)
    return jnp.stack([c / 2, s / 2, angle, 3 * c / 2, s / 2, -angle, 2 * c, none, none])


def slider_crank_turning(angle, rate):
    """Angular acceleration of the crank, from ½ J(θ) θ̇² = const."""
    masses = np.array([1, 1, 1 / 12, 1, 1, 1 / 12, 1, 1, 1])

    def inertia(angle):
        return jnp.sum(masses * jax.jacfwd(slider_crank_places)(angle) ** 2)

    return -0.5 * jax.grad(inertia)(angle) * rate**2 / inertia(angle)


def test_the_acceleration_at_a_singular_position():
    """At the bifurcation LU gives NaN; the limit along the branch is wanted."""
    system, slope = rj.assemble(slider_crank(np.pi / 2)), jax.jacfwd(slider_crank_places)

    @jax.jit
    def both(angle):
        wanted = slope(angle) * slider_crank_turning(angle, 1.0) + jax.jacfwd(slope)(angle)
        return system.acceleration(0.0, slider_crank_places(angle), slope(angle))[0], wanted

    a, wanted = map(np.asarray, both(np.pi / 2))
    assert np.max(np.abs(a - wanted)) <= LIMIT


@pytest.mark.slow
def test_passing_a_bifurcation():
    """H3b. In steps of 0.01 s the crank passes 90° and the slider reaches −2 m. Unprojected, the
    angle is wrong by 5e-3.
    """
    ts, keep = np.linspace(0.0, 8.0, 801), rj.Projection()
    cranked = rj.assemble(slider_crank(np.pi / 4))
    motion = run(cranked, ts, solver=RK4(), dt=0.01, stabilization=keep)
    crank = rj.CustomSystem(
        unit_mass,
        lambda t, q, v: slider_crank_turning(q[0], v[0])[None],
        q0=[np.pi / 4],
        v0=[1.0],
    )
    wanted = run(crank, ts, rtol=IDENTITY)
    assert np.max(np.abs(motion.q[:, 2] - wanted.q[:, 0])) <= PASSING
    energy = kinetic(motion)
    assert np.max(np.abs(energy / energy[0] - 1)) <= PASSING
    assert abs(np.min(motion.q[:, 6]) + 2) <= 1e-3


def test_fixed_steps_that_are_far_too_long_are_no_success():
    """Nothing is promised of joints in fixed steps, but none may fly apart without a word."""
    blown = run(rj.assemble(four_bar()), np.arange(21) / 5, solver=RK4(), dt=0.2, throw=False)
    assert np.max(blown.violation) > 1e9
    assert blown.status == rj.Status.CONSTRAINTS_VIOLATED


@pytest.mark.slow
def test_a_stiff_mode():
    """A stiff mode. f₂ = 100 kHz: explicit methods take 600 000 steps for one second."""
    system = rj.assemble(rj.gallery.cart_pendulum(f2=1e5))
    ts = np.linspace(0.0, 1.0, 101)
    motion, truth = (run(system, ts, solver=None, rtol=rtol) for rtol in (1e-6, 1e-10))
    assert motion.solver_name == "Rodas5P"
    assert motion.stats.num_steps <= STIFF_STEPS
    assert rj.compare(truth, motion).error <= STIFF_ERROR


@pytest.mark.slow
def test_single_precision_where_it_can_and_where_not():
    """The cart in steps of 2e-4 s is right to 1e-5; a mass ratio of 1e4 is refused."""
    truth = shared(cart_pendulum)
    settings = {"solver": diffrax.Tsit5(), "stabilization": rj.Projection(), "audit": False}
    with jax.enable_x64(False):
        cart, heavy = rj.assemble(cart_pendulum()), rj.assemble(four_bar(1e4))
        with pytest.warns(UserWarning, match="single precision"):
            motion = rj.simulate(cart, np.asarray(truth.t), dt=2e-4, **settings)
        with (
            pytest.warns(UserWarning, match="single precision"),
            pytest.raises(rj.SimulationError, match="masses that a joint connects"),
        ):
            rj.simulate(heavy, [0.0, 0.1], **settings)
    assert motion.q.dtype == jnp.float32
    wide = dataclasses.replace(truth, q=jnp.asarray(motion.q, float))
    assert rj.compare(truth, wide).error <= SINGLE
