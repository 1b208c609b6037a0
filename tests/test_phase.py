"""Bodies that turn or swing more often than tolerances allow for: a flag tells, and only there."""

import jax
import numpy as np
import pytest
from comparison import assert_close
from scipy.integrate import solve_ivp
from test_many_turns import (
    ALLOWED,
    CASES,
    LENGTH,
    RTOL,
    SPEED,
    SPIN,
    STIFFNESS,
    TIGHT,
    TURNS,
    tip,
    true_position,
    true_vibration,
)
from zoo import GRAVITY, RODAS5P, bar

import romjax as rj

# Estimates and thresholds of them are right by this factor.
CLEAR = 5.0
TORQUE, TS = 8.0, np.linspace(0.0, 7.0, 141)


def driven() -> rj.Scene:
    """A pendulum that hangs at rest until a torque makes it go round, 90 times in 7 s."""
    scene = bar(angle=-np.pi / 2)
    torque = rj.Torque(scene.bodies[0].at(), rj.Constant(TORQUE))
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, torque])


def true_driven(ts) -> np.ndarray:
    """φ'' = −3 g cos φ / (2 L) + 3 τ / (m L²) of a bar of one metre and one kilogram."""
    seen = solve_ivp(
        lambda t, y: [y[1], -1.5 * GRAVITY * np.cos(y[0]) + 3 * TORQUE],
        (0.0, ts[-1]), [-np.pi / 2, 0.0], t_eval=ts, **TIGHT,
    )  # fmt: skip
    return np.stack([np.cos(seen.y[0]), np.sin(seen.y[0])], -1)


def test_a_body_that_a_torque_turns_later():
    """Nothing at its start tells its turns."""
    system, truth = rj.assemble(driven()), true_driven(TS)
    with pytest.warns(
        UserWarning,
        match="simulate: its bodies turn, swing or bounce so many times .* rtol = 1.0e-06",
    ):
        run = rj.simulate(system, TS)
    assert run.flags == rj.Flag.PHASE
    assert "errors of their speed add up" in run.warnings()
    assert np.max(np.abs(tip(run) - truth)) > ALLOWED
    finer = rj.simulate(system, TS, rtol=1e-8)
    assert finer.is_valid
    assert_close(tip(finer), truth, ALLOWED)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:simulate. its bodies turn, swing or bounce so many times")
@pytest.mark.parametrize("solver", [None, RODAS5P], ids=["default", "Rodas5P"])
@pytest.mark.parametrize("case", CASES)
def test_tolerances_that_are_given(case, solver):
    """Their steps allow for no turns. Lanes of a batch have flags of their own."""
    make, seen, truth = CASES[case]
    whole = rj.assemble(make())
    every = 2 * np.pi * TURNS[:, None] / SPIN * np.linspace(0.0, 1.0, 101)

    def lane(ts):
        return rj.simulate(whole, ts, solver=solver, atol=RTOL, throw=False).flags

    flags = np.asarray(jax.jit(jax.vmap(lane))(every)) & rj.Flag.PHASE
    errors = []
    for ts, flag in zip(every, flags, strict=True):
        run = rj.simulate(whole, ts, solver=solver, atol=RTOL)
        assert run.flags == flag
        errors.append(np.max(np.abs(seen(run) - truth(ts))))
    assert np.all(flags[np.array(errors) > CLEAR * ALLOWED])
    assert not np.any(flags[np.array(errors) < ALLOWED / CLEAR])
    assert flags[-1]
    assert not flags[0]


@pytest.mark.slow
def test_a_motor_takes_errors_back():
    """They add up in the balance of energy, and not in the angle that the motor holds."""
    scene = bar(angle=-np.pi / 2)
    motor = rj.Motor(scene.bodies[0].at(), rj.ground.at(), rj.Ramp(10.0), 10.0, 5.0)
    system = rj.assemble(rj.Scene(scene.bodies, scene.joints, [*scene.effects, motor]))
    assert rj.simulate(system, np.linspace(0.0, 40.0, 101)).is_valid


def wheel_on_a_carriage(inertia, spin=0.0, torque=None) -> rj.Scene:
    """The carriage vibrates on a spring."""
    at = {"position": (0.1, 0.0)}
    carriage = rj.RigidBody("carriage", 1.0, 1.0, **at)
    wheel = rj.RigidBody("wheel", 1.0, inertia, angular_velocity=spin, **at)
    joints = [
        rj.Prismatic(carriage.at(), rj.ground.at()),
        rj.Revolute(wheel.at(), carriage.at()),
    ]
    spring = rj.Spring(carriage.at(), rj.ground.at((-1.0, 0.0)), 200.0, rest_length=1.0)
    loads = [] if torque is None else [rj.Torque(wheel.at(), rj.Constant(torque))]
    return rj.Scene([carriage, wheel], joints, [spring, *loads])


def test_errors_of_a_carriage_are_none_of_the_wheel_that_a_motor_turns():
    """637 turns of a constant acceleration, in which no step errs."""
    inertia, torque, ts = 1e-3, 0.02, np.linspace(0.0, 20.0, 101)
    run = rj.simulate(rj.assemble(wheel_on_a_carriage(inertia, torque=torque)), ts)
    assert run.is_valid
    assert_close(run["wheel.phi"], 0.5 * torque / inertia * ts**2, ALLOWED)


@pytest.mark.slow
def test_a_wheel_that_nothing_moves():
    """Errors of the carriage, which vibrates for long, are none of the angle of its wheel."""
    system = rj.assemble(wheel_on_a_carriage(1e-5, spin=100.0))
    run = rj.simulate(system, np.linspace(0.0, 20.0, 101), solver=RODAS5P, atol=RTOL)
    assert run.is_valid
    # What speed the errors of the energy would give to the wheel.
    energy = rj.energy(system, run)
    share = np.max(np.abs(energy.balance)) / np.max(energy.kinetic)
    assert 100.0 * 20.0 * share / 4 > ALLOWED


@pytest.mark.slow
def test_bodies_without_a_link_have_energies_of_their_own():
    """What a carriage that vibrates by itself loses is no error of a pendulum, which has none."""
    scene = driven()
    carriage = rj.RigidBody("carriage", 1000.0, 1.0, position=(0.1, 0.0))
    rail = rj.Prismatic(carriage.at(), rj.ground.at())
    spring = rj.Spring(carriage.at(), rj.ground.at((-1.0, 0.0)), 1e7, rest_length=1.0)
    bodies, joints = (*scene.bodies, carriage), (*scene.joints, rail)
    system = rj.assemble(rj.Scene(bodies, joints, [*scene.effects, spring]))
    ts = np.linspace(0.0, 1.6, 101)
    run = rj.simulate(system, ts)
    assert run.is_valid
    assert_close(tip(run), true_driven(ts), ALLOWED)


def test_a_balance_wheel():
    """Errors of its energy, which would be a large one of a pendulum, are none of its frequency."""
    wheel = rj.RigidBody("wheel", 1.0, 1.0, angle=4.0)
    spring = rj.TorsionSpring(wheel.at(), rj.ground.at(), 100.0)
    system = rj.assemble(rj.Scene([wheel], [rj.Revolute(wheel.at(), rj.ground.at())], [spring]))
    ts = np.linspace(0.0, 2 * np.pi * 3, 101)
    run = rj.simulate(system, ts, atol=RTOL)
    assert run.is_valid
    assert_close(run["wheel.phi"], 4.0 * np.cos(10.0 * ts), ALLOWED, 4.0)
    energy = rj.energy(system, run)
    # What errors of the energy would make of the angle of a pendulum.
    share = np.max(np.abs(energy.balance)) / np.max(energy.kinetic)
    assert 40.0 * ts[-1] * share / 8 > ALLOWED


def test_a_body_that_vibrates_along_a_rail_does_not_go_round():
    """It turns back at each end, to the left or to the right by rounding, which is no half of a
    round. The farther it gets, the faster it vibrates.
    """
    tilt = 0.7
    out = np.array([np.cos(tilt), np.sin(tilt)])
    body = rj.RigidBody("body", 1.0, 1.0, position=out, angle=tilt)
    rail = rj.Prismatic(body.at(), rj.ground.at((0.0, 0.0), angle=tilt))
    spring = rj.Spring(body.at(), rj.ground.at((-out[1], out[0])), 100.0, rest_length=0.9)
    system = rj.assemble(rj.Scene([body], [rail], [spring]))
    ts = np.linspace(0.0, 8.0, 101)
    run = rj.simulate(system, ts, atol=RTOL)
    assert run.is_valid
    along = run["body.x"] * out[0] + run["body.y"] * out[1]
    assert_close(along, true_vibration(ts, 1.0, 100.0), ALLOWED)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:simulate. its bodies turn, swing or bounce so many times")
@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_a_body_that_goes_round_on_a_spring(space):
    """In the plane and in space, by tolerances that are given."""
    own = {
        "position": (1.0, 0.0, 0.0)[: 2 + space],
        "velocity": (0.0, SPEED * 0.6, SPEED * 0.8) if space else (0.0, SPEED),
    }
    make, inertia = (rj.spatial.RigidBody, np.ones(3)) if space else (rj.RigidBody, 1.0)
    body = make("body", 1.0, inertia, **own)
    centre = rj.ground.at((0.0,) * (2 + space))
    spring = rj.Spring(body.at(), centre, STIFFNESS, rest_length=LENGTH)
    system = rj.assemble(rj.Scene([body], effects=[spring]))
    for end, often in ((2.0, False), (50.0, True)):
        ts = np.linspace(0.0, end, 101)
        run, truth = rj.simulate(system, ts, solver=RODAS5P, atol=RTOL), true_position(ts)
        across = 0.6 * run["body.y"] + 0.8 * run["body.z"] if space else run["body.y"]
        wrong = np.max(np.abs(np.stack([run["body.x"], across], -1) - truth)) > ALLOWED
        assert wrong == often
        assert run.flags == (rj.Flag.PHASE if often else 0)


def true_heights(height, stiffness, tops) -> tuple[np.ndarray, np.ndarray]:
    """Times and heights of a ball of one kilogram that falls onto a floor without a loss: at so
    many of its highest places, and a quarter of a flight later.
    """
    speed, flight = np.sqrt(2 * GRAVITY * height), np.sqrt(8 * height / GRAVITY)

    def leaves(t, y):
        return y[0]

    leaves.terminal, leaves.direction = True, 1.0
    touch = solve_ivp(
        lambda t, y: [y[1], stiffness * max(-y[0], 0.0) ** 1.5 - GRAVITY],
        (0.0, 1.0), [-1e-300, -speed], events=leaves, **TIGHT,
    )  # fmt: skip
    later = np.array([0.0, 0.25])[None] * flight
    ts = np.arange(tops)[:, None] * (flight + touch.t[-1]) + later
    return ts.ravel(), np.tile(height - GRAVITY / 2 * later.ravel() ** 2, tops)


@pytest.mark.filterwarnings("ignore:simulate. its bodies turn, swing or bounce so many times")
@pytest.mark.parametrize("across", [0.0, 5.0], ids=["on the spot", "along the floor"])
def test_a_ball_that_bounces(across):
    """Each bounce errs by a little of its energy, which makes all flights longer that follow: sixty
    are off by a thousandth of their height, which is little of a way along the floor.
    """
    height, stiffness = 1.0, 1e6
    ball = rj.RigidBody("ball", 1.0, 0.1, position=(0.0, height), velocity=(across, 0.0))
    floor = rj.Contact(ball.at(), rj.ground.at(), rj.Line(), stiffness)
    system = rj.assemble(rj.Scene([ball], effects=[rj.Gravity(), floor]))
    ts, heights = true_heights(height, stiffness, 60)
    reach = max(height, across * ts[-1])

    def wrong(run):
        return np.max(np.abs(run["ball.y"] - heights)) / reach

    run, finer = rj.simulate(system, ts), rj.simulate(system, ts, rtol=1e-8)
    assert (wrong(run) > CLEAR * ALLOWED) == (across == 0)
    assert run.flags == (rj.Flag.PHASE if wrong(run) > ALLOWED else 0)
    assert finer.is_valid
    assert wrong(finer) < ALLOWED
    # Few of them are right by the tolerances of any run.
    few = rj.simulate(system, ts[:8])
    assert few.is_valid
    assert_close(few["ball.y"], heights[:8], ALLOWED, height)
