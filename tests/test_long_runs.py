"""Long runs: drift, energy over thousands of seconds, and what stabilisation costs."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import GRAVITY, RK4, linkage, point_pendulum
from tolerances import IDENTITY, SOLVED

import romjax as rj

# Required figures, case by case.
LONG_ENERGY, LONG_DRIFT = 5e-4, 1e-12  # 1000 s in steps of 0.01 s
ADAPTIVE_ENERGY, ADAPTIVE_DRIFT = 1e-6, 1e-10  # 2000 s
PARALLEL = 1e-7  # after 20 s through singular positions
DECAY = 0.01
ENERGY = 1e-7  # of many parts over 10 s


@pytest.fixture(scope="module")
def pendulum() -> rj.CustomSystem:
    return point_pendulum()


def energy_error(motion) -> float:
    """Relative to m g L."""
    total = 0.5 * np.sum(np.square(motion.v), axis=1) + GRAVITY * np.asarray(motion.q[:, 1])
    return float(np.max(np.abs(total))) / GRAVITY


def test_drift_over_a_thousand_seconds(pendulum):
    """H6. In steps of 0.01 s; unstabilised the bar stretches until everything is NaN."""
    settings = {"solver": RK4(), "dt": 0.01, "max_steps": 200_000}
    ts = jnp.linspace(0.0, 1000.0, 1001)
    kept = rj.simulate(pendulum, ts, stabilization=rj.Projection(), **settings)
    assert np.max(kept.violation) <= LONG_DRIFT
    assert energy_error(kept) <= LONG_ENERGY
    lost = rj.simulate(pendulum, ts, stabilization=None, throw=False, **settings)
    assert not lost.success


@pytest.mark.slow
def test_two_thousand_seconds_of_a_pendulum(pendulum):
    """IFToMM problem A01 with step size control: energy, drift, and the place at the end."""
    motion = rj.simulate(
        pendulum,
        jnp.linspace(0.0, 2000.0, 2001),
        solver=diffrax.Dopri8(),
        rtol=1e-12,
        stabilization=rj.Projection(),
        max_steps=200_000,
    )
    assert energy_error(motion) <= ADAPTIVE_ENERGY
    assert np.max(motion.violation) <= ADAPTIVE_DRIFT
    angle = -0.952044523415683
    assert np.allclose(motion.q[-1], [np.sin(angle), -np.cos(angle)], rtol=0, atol=PARALLEL)


@pytest.mark.slow
def test_a_parallel_four_bar():
    """IFToMM problem A02, N = 2: five bars of 1 m and 1 kg through twenty level positions in 20 s,
    in each of which the constraints lose rank. The place of B0 at 10 s and 20 s.
    """
    points, velocities, bars = {}, {}, []
    for i, (foot, top) in enumerate(zip("ABC", "abc", strict=True)):
        points |= {foot: (i, 0), top: (i, 1)}
        velocities[top] = (1.0, 0.0)
        bars.append((foot, top))
    system = rj.assemble(linkage(points, [*bars, ("a", "b"), ("b", "c")], velocities, gravity=True))
    motion = rj.simulate(
        system,
        jnp.array([0.0, 10.0, 20.0]),
        solver=diffrax.Dopri8(),
        rtol=1e-11,
        stabilization=rj.Projection(),
    )
    wanted = [[0.328458111540815, 0.944518538178601], [0.839746574306844, 0.542978536352885]]
    assert np.allclose(2 * motion.q[1:, :2], wanted, rtol=0, atol=PARALLEL)


def test_stabilisation_that_sets_the_step(pendulum):
    """H7. α = 1000, β = 2.5e5 costs 30 times the steps; the warning names the rates."""
    ts = jnp.linspace(0.0, 10.0, 11)

    def run(alpha, beta):
        stabilization = rj.Baumgarte(alpha, beta)
        return rj.simulate(pendulum, ts, solver=diffrax.Tsit5(), stabilization=stabilization)

    well = run(5.0, 10.5)
    with pytest.warns(UserWarning, match=r"decay at 500 /s.*fastest.*2\.\d+ rad/s.*steps of 0\.00"):
        fast = run(1000.0, 2.5e5)
    assert fast.stats["num_steps"] > 20 * well.stats["num_steps"]


def test_a_start_off_the_constraints_decays(pendulum):
    """H8. C = C₀ (1 + αt/2) exp(−αt/2) for critical damping; and `consistent` mends the start."""
    alpha, off = 10.0, jnp.array([1.01, 0.0])
    motion = rj.simulate(
        pendulum,
        jnp.array([0.0, 1.0]),
        q0=off,
        solver=RK4(),
        dt=0.01,
        stabilization=rj.Baumgarte(alpha, alpha**2 / 4),
        throw=False,
    )
    assert motion.status == rj.Status.INCONSISTENT_START
    decay = (1 + alpha / 2) * np.exp(-alpha / 2)
    assert abs(motion.violation[1] / (motion.violation[0] * decay) - 1) <= DECAY
    q, _ = rj.consistent(pendulum, off)
    assert np.allclose(q, [1.0, 0.0], rtol=0, atol=IDENTITY)


def test_energy_of_many_parts():
    """A bob on a sprung slide, and geared wheels with an eccentric mass, over ten seconds."""
    slope = -0.3
    block = rj.RigidBody("block", 1.0, 0.1, angle=slope)
    bob = rj.RigidBody("bob", 0.5, 0.01, position=(0.6, 0.0))
    big = rj.RigidBody("big", 2.0, 0.4, position=(3.0, 0.0))
    small = rj.RigidBody("small", 0.5, 0.05, position=(4.0, 0.0))
    lump = rj.RigidBody("lump", 0.3, 0.01, position=(4.2, 0.0))
    joints = [
        rj.Prismatic(block.at(), rj.ground.at(angle=slope)),
        rj.Distance(bob.at(), block.at(), length=0.6),
        rj.Revolute(big.at(), rj.ground.at((3.0, 0.0))),
        rj.Revolute(small.at(), rj.ground.at((4.0, 0.0))),
        rj.Gear(small.at(), big.at(), ratio=-3.0),
        rj.Weld(lump.at(), small.at((0.2, 0.0))),
    ]
    effects = [
        rj.Gravity(),
        rj.Spring(block.at(), rj.ground.at(), stiffness=40.0, cubic=300.0),
        rj.TorsionSpring(big.at(), rj.ground.at(), stiffness=5.0, rest_angle=0.2),
        rj.Bushing(bob.at(), block.at((0.3, -0.4)), [3.0, 6.0, 0.4]),
    ]
    bodies = [block, bob, big, small, lump]
    system = rj.assemble(rj.Scene(bodies, joints, effects))
    run = rj.simulate(system, jnp.linspace(0.0, 10.0, 51), rtol=1e-9, solver=diffrax.Dopri8())

    def energy(q, v):
        x, angle = q.reshape(5, 3)[:, :2], q.reshape(5, 3)[:, 2]
        height = sum(body.mass * x[i, 1] for i, body in enumerate(bodies))
        stretch = x[0] @ x[0]
        cos, sin = jnp.cos(angle[0]), jnp.sin(angle[0])
        away = jnp.array([[cos, sin], [-sin, cos]]) @ (x[1] - x[0]) - jnp.array([0.3, -0.4])
        away = jnp.append(away, angle[1] - angle[0])
        return (
            system.kinetic_energy(q, v)
            + 9.81 * height
            + 20.0 * stretch
            + 75.0 * stretch**2
            + 2.5 * (angle[2] - 0.2) ** 2
            + 0.5 * jnp.array([3.0, 6.0, 0.4]) @ away**2
        )

    found = jax.vmap(energy)(run.q, run.v)
    size = jnp.max(jax.vmap(system.kinetic_energy)(run.q, run.v))
    assert jnp.max(jnp.abs(found - found[0])) <= ENERGY * size
    across = run.q[:, :2] @ jnp.array([-np.sin(slope), np.cos(slope)])
    assert jnp.max(jnp.abs(across)) <= SOLVED
