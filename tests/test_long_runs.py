"""Long runs: drift, energy over thousands of seconds, and what stabilisation costs."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import meshes
import numpy as np
import pytest
from mechanisms import RK4, linkage
from tolerances import IDENTITY, SOLVED
from zoo import GRAVITY, point_pendulum, run

import romjax as rj
from romjax.system import dynamics

# Required figures, case by case.
LONG_ENERGY, LONG_DRIFT = 5e-4, 1e-12  # 1000 s in steps of 0.01 s
ADAPTIVE_ENERGY, ADAPTIVE_DRIFT = 1e-6, 1e-10  # 2000 s
PARALLEL = 1e-7  # after 20 s through singular positions
DECAY = 0.01
ENERGY = 1e-7  # of many parts over 10 s
DISSIPATED = 0.1  # of the largest kinetic energy, at least
SLOPE = -0.3  # [rad] of the slide


@pytest.fixture(scope="module")
def pendulum() -> rj.CustomSystem:
    return point_pendulum()


def energy_error(motion) -> float:
    """Relative to m g L."""
    q, v = np.asarray(motion.q), np.asarray(motion.v)
    return float(np.max(np.abs(0.5 * np.sum(v**2, axis=1) + GRAVITY * q[:, 1]))) / GRAVITY


@pytest.mark.slow
def test_drift_over_a_thousand_seconds(pendulum):
    """In steps of 0.01 s; unstabilised the bar stretches until everything is NaN."""
    settings = {"solver": RK4(), "dt": 0.01, "max_steps": 200_000}
    ts = np.linspace(0.0, 1000.0, 1001)
    kept = run(pendulum, ts, stabilization=rj.Projection(), **settings)
    assert np.max(kept.violation) <= LONG_DRIFT
    assert energy_error(kept) <= LONG_ENERGY
    lost = run(pendulum, ts, stabilization=None, throw=False, **settings)
    assert not lost.success


@pytest.mark.slow
def test_two_thousand_seconds_of_a_pendulum(pendulum):
    """IFToMM problem A01 with step size control: energy, drift, and the place at the end."""
    motion = run(
        pendulum,
        np.linspace(0.0, 2000.0, 2001),
        rtol=1e-12,
        stabilization=rj.Projection(),
        max_steps=200_000,
    )
    assert energy_error(motion) <= ADAPTIVE_ENERGY
    assert np.max(motion.violation) <= ADAPTIVE_DRIFT
    angle = -0.952044523415683
    end = np.asarray(motion.q)[-1]
    assert np.allclose(end, [np.sin(angle), -np.cos(angle)], rtol=0, atol=PARALLEL)


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
    ts = np.array([0.0, 10.0, 20.0])
    motion = run(system, ts, rtol=1e-11, stabilization=rj.Projection())
    wanted = [[0.328458111540815, 0.944518538178601], [0.839746574306844, 0.542978536352885]]
    assert np.allclose(2 * np.asarray(motion.q)[1:, :2], wanted, rtol=0, atol=PARALLEL)


def test_stabilisation_that_sets_the_step(pendulum):
    """α = 1000, β = 2.5e5 costs 30 times the steps; the warning names the rates."""
    ts = np.linspace(0.0, 10.0, 11)

    def steps(alpha, beta):
        settings = {"rtol": 1e-6, "stabilization": rj.Baumgarte(alpha, beta)}
        return run(pendulum, ts, **settings).stats.num_steps

    well = steps(5.0, 10.5)
    with pytest.warns(UserWarning, match=r"decay at 500 /s.*fastest.*2\.\d+ rad/s.*steps of 0\.00"):
        fast = steps(1000.0, 2.5e5)
    assert fast > 20 * well


def test_a_start_off_the_constraints_decays(pendulum):
    """C = C₀ (1 + αt/2) exp(−αt/2) for critical damping; and `consistent` mends the start."""
    alpha, off = 10.0, np.array([1.01, 0.0])
    keep = rj.Baumgarte(alpha, alpha**2 / 4)
    motion = run(pendulum, np.array([0.0, 1.0]), q0=off, stabilization=keep, throw=False)
    assert motion.status == rj.Status.INCONSISTENT_START
    decay = (1 + alpha / 2) * np.exp(-alpha / 2)
    violation = np.asarray(motion.violation)
    assert abs(violation[1] / (violation[0] * decay) - 1) <= DECAY
    q, _ = rj.consistent(pendulum, off)
    assert np.allclose(q, [1.0, 0.0], rtol=0, atol=IDENTITY)


def many_parts(damped=1.0) -> tuple[rj.AbstractSystem, Callable]:
    """A bob on a sprung slide, geared wheels with an eccentric mass, and every kind of damping,
    times `damped`; its energy.
    """
    block = rj.RigidBody("block", 1.0, 0.1, angle=SLOPE)
    bob = rj.RigidBody("bob", 0.5, 0.01, position=(0.6, 0.0))
    big = rj.RigidBody("big", 2.0, 0.4, position=(3.0, 0.0))
    small = rj.RigidBody("small", 0.5, 0.05, position=(4.0, 0.0))
    lump = rj.RigidBody("lump", 0.3, 0.01, position=(4.2, 0.0))
    joints = [
        rj.Prismatic(block.at(), rj.ground.at(angle=SLOPE)),
        rj.Distance(bob.at(), block.at(), length=0.6),
        rj.Revolute(big.at(), rj.ground.at((3.0, 0.0))),
        rj.Revolute(small.at(), rj.ground.at((4.0, 0.0))),
        rj.Gear(small.at(), big.at(), ratio=-3.0),
        rj.Weld(lump.at(), small.at((0.2, 0.0))),
    ]
    effects = [
        rj.Damper(block.at(), rj.ground.at((-1.0, 0.3)), damping=0.2 * damped, along_line=True),
        rj.Damper(bob.at(), rj.ground.at(), damping=0.05 * damped),
        rj.TorsionDamper(big.at(), small.at(), damping=0.01 * damped),
        rj.Bushing(bob.at(), rj.ground.at(), np.zeros(3), damped * np.array([0.05, 0.1, 0.01])),
        # So soft that its energy does not count, so that all it does is rub.
        rj.Contact(
            small.at((0.0, -0.3)),
            rj.ground.at((0.0, 1.0)),
            rj.Line(),
            stiffness=1e-9,
            friction=rj.Friction(0.3, static=0.4, stribeck=0.2),
        ),
        rj.Gravity(),
        rj.Spring(block.at(), rj.ground.at(), stiffness=40.0, cubic=300.0),
        rj.TorsionSpring(big.at(), rj.ground.at(), stiffness=5.0, rest_angle=0.2),
        rj.Bushing(bob.at(), block.at((0.3, -0.4)), [3.0, 6.0, 0.4]),
    ]
    bodies = [block, bob, big, small, lump]
    system = rj.assemble(rj.Scene(bodies, joints, effects))

    def energy(q, v):
        x, angle = q.reshape(5, 3)[:, :2], q.reshape(5, 3)[:, 2]
        height = sum(body.mass * x[i, 1] for i, body in enumerate(bodies))
        stretch = x[0] @ x[0]
        cos, sin = jnp.cos(angle[0]), jnp.sin(angle[0])
        away = jnp.array([[cos, sin], [-sin, cos]]) @ (x[1] - x[0]) - jnp.array([0.3, -0.4])
        away = jnp.append(away, angle[1] - angle[0])
        return (
            dynamics.kinetic_energy(system, q, v)
            + 9.81 * height
            + 20.0 * stretch
            + 75.0 * stretch**2
            + 2.5 * (angle[2] - 0.2) ** 2
            + 0.5 * jnp.array([3.0, 6.0, 0.4]) @ away**2
        )

    return system, energy


def history(system, energy, outputs=51):
    """Energy over ten seconds, in units of the largest kinetic one, and the motion."""
    ts = np.linspace(0.0, 10.0, outputs)
    made = run(system, ts, rtol=1e-9, stabilization="default", max_steps=200_000)
    kinetic = functools.partial(dynamics.kinetic_energy, system)
    both = jax.jit(jax.vmap(lambda q, v: (energy(q, v), kinetic(q, v))))
    found, kinetic = map(np.asarray, both(made.q, made.v))
    return found / np.max(kinetic), made


@pytest.mark.slow
def test_energy_and_dissipation_of_many_parts():
    """Kept without damping; with every kind of it, it falls from output to output."""
    found, made = history(*many_parts(0.0), outputs=1001)
    assert np.max(np.abs(found - found[0])) <= ENERGY
    across = np.asarray(made.q)[:, :2] @ np.array([-np.sin(SLOPE), np.cos(SLOPE)])
    assert np.max(np.abs(across)) <= SOLVED
    found, _ = history(*many_parts(), outputs=1001)
    assert np.all(np.diff(found) <= ENERGY)
    assert found[-1] < found[0] - DISSIPATED


@pytest.mark.slow
def test_energy_of_flexible_parts():
    """A stiffened blade on a sprung hub, and a mesh that hangs from its tip."""
    hub = rj.RigidBody("hub", 1.0, 0.02)
    blade = rj.Beam(
        "blade",
        0.4,
        1.0,
        EI=30.0,
        modes=2,
        shapes="clamped-free",
        stiffening=True,
        position=(0.5, 0.0),
    )
    stiffness, mass, nodes = meshes.beam(4, 0.6, 0.3, EA=300.0, EI=0.5)
    ends = {"top": 0, "bottom": 4}
    tail = rj.ModalBody.of_mesh(
        "tail",
        stiffness,
        mass,
        nodes,
        ends,
        modes=1,
        position=(1.0, -0.3),
        angle=-np.pi / 2,
    )
    joints = [
        rj.Revolute(hub.at(), rj.ground.at()),
        rj.Weld(blade.at((-0.5, 0.0)), hub.at()),
        rj.Revolute(tail.at("top"), blade.at((0.5, 0.0))),
    ]
    spring = rj.TorsionSpring(hub.at(), rj.ground.at(), stiffness=3.0)
    bodies = [hub, blade, tail]
    system = rj.assemble(rj.Scene(bodies, joints, [rj.Gravity(), spring]))
    places = np.cumsum([body.size for body in bodies])[:-1]

    def energy(q, v):
        parts = list(zip(bodies, jnp.split(q, places), strict=True))
        elastic = sum(body.elastic_energy(own) for body, own in parts)
        height = sum(body.first_moment(own)[1] for body, own in parts)
        return dynamics.kinetic_energy(system, q, v) + elastic + 9.81 * height + 1.5 * q[2] ** 2

    found, _ = history(system, energy)
    assert np.max(np.abs(found - found[0])) <= ENERGY
