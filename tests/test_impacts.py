"""Impacts: momentum and energy are balanced, and joints hold."""

import diffrax
import jax
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from tolerances import IDENTITY, SOLVED
from verification_problems.events import (
    ASIDE,
    BALL,
    BALLS,
    LENGTH,
    RADIUS,
    cradle,
    knocks,
)
from zoo import run as moved

import romjax as rj
from romjax.system import dynamics

G = 9.81
TS = np.linspace(0.0, 1.0, 21)
PROJECTED = rj.Projection()


@pytest.mark.parametrize(
    "stabilization",
    in_groups(["default", PROJECTED], slow=[PROJECTED]),
    ids=["default", "projected"],
)
def test_newtons_cradle(stabilization):
    """The momentum of the first ball passes to the last, through those that stay at rest, and back,
    with all energy.
    """
    scene = cradle()
    system, impacts = rj.assemble(scene), knocks(scene)
    run = rj.simulate(
        system,
        np.linspace(0.0, 4.0, 101),
        events=impacts,
        rtol=1e-12,
        solver=diffrax.Dopri8(),
        stabilization=stabilization,
    )
    events, count = run.events, int(run.events.count)
    assert count == 6
    assert run.is_valid
    # From the first to the last and back, one end of the row after the other.
    assert np.argmax(np.asarray(events.happened)[:count], axis=1).tolist() == [0, BALLS - 2] * 3
    inertia = BALL * LENGTH**2 + 0.4 * BALL * RADIUS**2
    energy = BALL * G * LENGTH * (1 - np.cos(ASIDE))
    rates = [np.asarray(v)[:count, 2::3] for v in (events.v_before, events.v_after)]
    assert_close(np.max(np.abs(rates[1]), axis=1), np.sqrt(2 * energy / inertia), SOLVED)
    for rate in rates:
        assert_close(0.5 * inertia * np.sum(rate**2, axis=1), energy, SOLVED, scale=energy)
    before, after = (np.sum(rate, axis=1) for rate in rates)
    assert_close(after, before, SOLVED)
    # All impulses are equal: those of one ball's momentum.
    impulse = np.asarray(events.impulse)
    assert_close(impulse[:count], impulse[0, 0], SOLVED)
    assert_close(run.balance.largest, 0.0, SOLVED, scale=energy)


def test_a_rod_falls_on_its_end():
    """By linear and angular momentum: p = (1 + e) u m / (1 + m l²/4I) at the end that hits."""
    mass, inertia, length, height, restitution = 0.8, 0.03, 0.6, 0.5, 0.7
    rod = rj.RigidBody("rod", mass, inertia, position=(0.0, height))
    system = rj.assemble(rj.Scene([rod], effects=[rj.Gravity()]))
    end = rod.at((length / 2, 0.0))
    gap = rj.quantity.Travel(end, rj.ground.at(angle=np.pi / 2))
    impact = rj.Impact(gap, restitution=restitution)
    run = moved(system, np.linspace(0.0, 0.33, 31), events=[impact], audit=True)
    speed = np.sqrt(2 * G * height)
    impulse = (1 + restitution) * speed * mass / (1 + mass * length**2 / (4 * inertia))
    assert int(run.events.count) == 1
    assert_close(run.events.times(), speed / G, SOLVED)
    assert_close(np.asarray(run.events.impulse)[0, 0], impulse, SOLVED)
    wanted = [0.0, -speed + impulse / mass, impulse * length / 2 / inertia]
    assert_close(np.asarray(run.events.v_after)[0], wanted, SOLVED)
    assert run.is_valid
    # The work of the impulse is what the motion loses.
    assert_close(run.balance.largest, 0.0, SOLVED)


@pytest.fixture(scope="module")
def double_pendulum():
    """A double pendulum, its lower end above the ground, let fall; and how it moves."""
    upper = rj.RigidBody("upper", 1.2, 0.02, position=(0.25, 0.0))
    lower = rj.RigidBody("lower", 0.7, 0.01, position=(0.7, 0.0))
    joints = [
        rj.Revolute(upper.at((-0.25, 0.0)), rj.ground.at()),
        rj.Revolute(lower.at((-0.2, 0.0)), upper.at((0.25, 0.0))),
    ]
    system = rj.assemble(rj.Scene([upper, lower], joints, [rj.Gravity()]))
    tip = rj.quantity.Travel(lower.at((0.2, 0.0)), rj.ground.at((0.0, -0.6), angle=np.pi / 2))
    impact = rj.Impact(tip, restitution=0.6)
    return system, impact, moved(system, TS, events=[impact])


def test_joints_hold_during_impacts(double_pendulum):
    """And take part: by the mass matrix of the two angles, in which no joint is left."""
    system, _, run = double_pendulum
    assert int(run.events.count) >= 2

    @jax.jit
    def rate_and_energy(q, v):
        state = dynamics.constraint_state(system, 0.0, q, v)
        return state.rate, dynamics.kinetic_energy(system, q, v)

    for i in range(2):
        events = run.events.q, run.events.v_before, run.events.v_after
        q, before, after = (np.asarray(x)[i] for x in events)
        a, b = q[2], q[5]

        def tangent(*lengths, a=a, b=b):
            """Of a point that is so far along both bars, by the two angles."""
            columns = [
                length * np.array([-np.sin(angle), np.cos(angle)])
                for length, angle in zip(lengths, (a, b), strict=True)
            ]
            return np.stack(columns, axis=1)

        centres = tangent(0.25, 0.0), tangent(0.5, 0.2)
        mass = 1.2 * centres[0].T @ centres[0] + 0.7 * centres[1].T @ centres[1]
        mass += np.diag([0.02, 0.01])
        row = tangent(0.5, 0.4)[1]
        response = np.linalg.solve(mass, row)
        rates = before[[2, 5]]
        impulse = -1.6 * (row @ rates) / (row @ response)
        assert_close(np.asarray(run.events.impulse)[i, 0], impulse, SOLVED, scale=impulse)
        assert_close(after[[2, 5]], rates + impulse * response, SOLVED)
        held, energy = rate_and_energy(q, after)
        assert_close(held, 0.0, SOLVED)
        lost = 0.5 * (1 - 0.6**2) * (row @ rates) ** 2 / (row @ response)
        assert_close(energy, 0.5 * rates @ mass @ rates - lost, SOLVED)


@pytest.mark.slow
def test_impacts_of_a_reduced_model(double_pendulum):
    """In minimal coordinates, without joints: the same times and velocities."""
    system, impact, run = double_pendulum
    rom = rj.reduce(system, rj.pod(run, rank=6), rj.Minimal())
    reduced = moved(rom, TS, events=[impact])
    assert int(reduced.events.count) == int(run.events.count)
    assert_close(reduced.events.times(), run.events.times(), 10 * SOLVED)
    found, wanted = (np.asarray(x.events.v_after)[0] for x in (reduced, run))
    assert_close(found, wanted, 10 * SOLVED)


@pytest.mark.slow
def test_a_racket_gives_energy():
    """A ball meets a body that moves by a prescribed motion, which its work keeps going."""
    racket = rj.RigidBody("racket", 1.0, 1.0)
    ball = rj.RigidBody("ball", 0.2, 1e-4, position=(1.0, 0.0))
    speed = 1.5
    joints = [
        rj.FixedAngle(racket.at(), rj.ground.at()),
        rj.PointOnLine(racket.at(), rj.ground.at()),
        rj.PrescribedTravel(racket.at(), rj.ground.at(), rj.Ramp(speed)),
    ]
    scene = rj.Scene([racket, ball], joints)
    system = rj.assemble(scene)
    q0, v0 = rj.consistent(system)
    impact = rj.Impact(rj.quantity.Travel(ball.at(), racket.at()), restitution=0.5)
    run = moved(system, TS, q0=q0, v0=v0, events=[impact], audit=True)
    assert_close(run.events.times(), 1.0 / speed, SOLVED)
    assert_close(np.asarray(run["ball.x'"])[-1], speed + 0.5 * speed, SOLVED)
    assert_close(np.asarray(run["racket.x'"])[-1], speed, SOLVED)
    assert run.is_valid
    assert_close(run.balance.largest, 0.0, IDENTITY)
