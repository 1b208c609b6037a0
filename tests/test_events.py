"""Events: when quantities pass their levels, and the derivatives of these times."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj

TS = jnp.linspace(0.0, 3.0, 31)
HEIGHT, G = 1.0, 9.81
BALL = rj.RigidBody("ball", 1.3, 0.1, position=(0.0, HEIGHT))
UP = rj.ground.at(angle=np.pi / 2)
HEIGHT_OF_BALL = rj.quantity.Travel(BALL.at(), UP)
# An explicit method, a stiff one, and one whose stages are found by iteration.
SOLVERS = (diffrax.Dopri8(), rj.Rodas5P(), diffrax.Kvaerno5())


def falling(g=G):
    return rj.assemble(rj.Scene([BALL], effects=[rj.Gravity((0.0, -g))]))


def thrown(*events, g=G, **settings):
    return rj.simulate(falling(g), TS, events=events, **{"rtol": TIGHT} | settings)


def bounces(count, g=G, restitution=0.8):
    """The times of the first impacts of a ball that is dropped."""
    first = jnp.sqrt(2 * HEIGHT / g)
    return first * (1 + 2 * sum(restitution**k for k in range(1, count)))


# Times.


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_a_bouncing_ball(solver):
    run = thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), solver=solver)
    count = int(run.events.count)
    assert count == 6
    assert_close(run.events.times(), [bounces(k + 1) for k in range(count)], SOLVED)
    speeds = np.sqrt(2 * G * HEIGHT) * 0.8 ** np.arange(count)
    assert_close(run.events.v_before[:count, 1], -speeds, SOLVED)
    assert_close(run.events.v_after[:count, 1], 0.8 * speeds, SOLVED)
    assert_close(run.events.impulse[:count, 0], 1.3 * 1.8 * speeds, SOLVED)
    assert run.is_valid
    assert np.all(np.isinf(run.events.time[count:]))
    # At the outputs, the flight after the last impact before.
    flights = np.searchsorted(run.events.times(), TS) - 1
    after = np.asarray(TS) - run.events.times()[flights]
    rising = 0.8 * speeds[flights] * after - 0.5 * G * after**2
    height = np.where(flights < 0, HEIGHT - 0.5 * G * np.asarray(TS) ** 2, rising)
    assert_close(run["ball.y"], height, SOLVED)


def test_directions_and_levels():
    """On its way a ball rises and falls through one height, and turns where its speed is zero."""
    height, speed = rj.quantity.Coordinate("ball.y"), rj.quantity.Coordinate("ball.y'")
    run = thrown(
        rj.Impact(HEIGHT_OF_BALL, restitution=0.9),
        rj.Crossing(height, level=0.3),
        rj.Crossing(height, level=0.3, direction="rising"),
        rj.Crossing(speed, direction="falling"),
        rj.Crossing(height, level=2.0),
    )
    events = run.events
    assert [len(events.times(i)) for i in range(5)] == [4, 8, 4, 4, 0]
    assert np.all(np.diff(events.time[: int(events.count)]) > 0)
    assert_close(events.times(2), events.times(1)[1::2], SOLVED)
    # The apex lies between the passages upwards and downwards.
    assert_close(events.times(3)[:3], (events.times(1)[1:6:2] + events.times(1)[2:8:2]) / 2, SOLVED)
    assert_close(
        events.q[: int(events.count), 1][events.happened[: int(events.count), 1]], 0.3, SOLVED
    )


def test_a_stop():
    """The run ends there, and so do its outputs."""
    run = thrown(rj.Stop(HEIGHT_OF_BALL, level=0.3))
    time = np.sqrt(2 * 0.7 / G)
    later = time < TS
    assert_close(run.t, np.where(later, time, TS), SOLVED)
    assert_close(run["ball.y"][later], 0.3, SOLVED)
    assert_close(run["ball.y'"][later], -G * time, SOLVED)
    assert run.is_valid
    assert_close(rj.energy(falling(), run).total, 1.3 * G * HEIGHT, SOLVED)


def test_the_period_of_a_pendulum():
    """By the complete elliptic integral of the first kind, in redundant and minimal coordinates."""
    angle, length, mass, inertia = 1.2, 0.7, 2.0, 0.1
    bob = rj.RigidBody(
        "bob",
        mass,
        inertia,
        position=(length * np.sin(angle), -length * np.cos(angle)),
        angle=angle,
    )
    scene = rj.Scene([bob], [rj.Revolute(bob.at((0.0, length)), rj.ground.at())], [rj.Gravity()])
    system = rj.assemble(scene)
    reduced_length = length + inertia / (mass * length)
    quarter = np.sqrt(reduced_length / G) * scipy.special.ellipk(np.sin(angle / 2) ** 2)
    wanted = quarter * np.arange(1, 9, 2)
    passes = rj.Crossing(rj.quantity.Turn(bob.at(), rj.ground.at()))
    ts = jnp.linspace(0.0, 8 * quarter, 50)
    run = rj.simulate(system, ts, rtol=TIGHT, events=[passes])
    assert_close(run.events.times(), wanted, SOLVED)
    rom = rj.reduce(system, rj.pod(run, rank=3), rj.Minimal())
    reduced = rj.simulate(rom, ts, rtol=TIGHT, events=[passes])
    assert_close(reduced.events.times(), wanted, SOLVED)
    assert_close(reduced.events.q[:4], run.events.q[:4], SOLVED)


def test_all_events_of_a_chaotic_motion():
    """Those that a search of dense output on a fine grid finds, and no others."""
    system = rj.assemble(rj.gallery.chain(3))
    rng = np.random.default_rng(5)
    labels = [rng.choice(system.structure.labels) + rng.choice(["", "'"]) for _ in range(8)]
    quantities = [rj.quantity.Coordinate(label) for label in labels]
    ts = jnp.linspace(0.0, 3.0, 61)
    # Steps that end at events are others, and the motion amplifies what they err by.
    settings = {"rtol": TIGHT / 10}
    free = rj.simulate(system, ts, **settings)
    levels = [float(rng.choice(free[label][1:-1])) for label in labels]
    crossings = [rj.Crossing(of, level) for of, level in zip(quantities, levels, strict=True)]
    run = rj.simulate(system, ts, events=crossings, dense=True, **settings)
    assert_close(run.q, free.q, SOLVED)
    fine = np.linspace(0.0, 3.0, 20_001)[1:-1]
    between = run.at(fine)
    total = 0
    for i, (label, level) in enumerate(zip(labels, levels, strict=True)):
        above = np.asarray(between[label]) > level
        before = np.flatnonzero(above[1:] != above[:-1])
        times = run.events.times(i)
        assert len(times) == len(before)
        assert np.all((times > fine[before] - SOLVED) & (times < fine[before + 1] + SOLVED))
        total += len(times)
    assert total > 20
    assert_close(run.at(run.events.time[:total]).q, run.events.q[:total], 10 * SOLVED)


def test_fixed_steps_end_at_events():
    """And go on in their grid."""
    run = thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), dt=0.05, solver=diffrax.Tsit5())
    assert_close(run.events.times(), [bounces(k + 1) for k in range(6)], SOLVED)
    assert int(run.stats.num_accepted_steps) == 60 + 6


# Derivatives.


@functools.cache
def derivatives(mode):
    """Of the fifth impact's time by gravity and restitution."""

    def fifth(g, restitution):
        return thrown(rj.Impact(HEIGHT_OF_BALL, restitution), g=g).events.time[4]

    if mode == "reverse":
        return jax.jit(jax.grad(fifth, (0, 1)))(G, 0.8)
    with rj.forward_mode():
        return jax.jit(jax.jacfwd(fifth, (0, 1)))(G, 0.8)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_derivatives_of_the_fifth_impact(mode):
    wanted = jax.grad(lambda g, e: bounces(5, g, e), (0, 1))(G, 0.8)
    assert_close(derivatives(mode), wanted, SOLVED)


@pytest.mark.slow
def test_derivatives_after_impacts_and_at_a_stop():
    """Of states beyond events, which move with their times."""

    def ends(g):
        stop = rj.Stop(rj.quantity.Rate(HEIGHT_OF_BALL), level=-2.0, direction="falling")
        # After the first impact the ball is slower than 2 m/s, until it falls again.
        run = thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), stop, g=g)
        between = 7  # of the output times, after the impact and before the stop
        return jnp.stack([run.q[between, 1], run.v[between, 1], run.t[-1], run.q[-1, 1]])

    slope = jax.jit(jax.jacrev(ends))(G)
    step = 1e-5
    differences = (ends(G + step) - ends(G - step)) / (2 * step)
    assert_close(slope, differences, DIFFERENCED, scale=1 + jnp.abs(differences))


def test_lanes_have_events_of_their_own():
    gravities = jnp.array([5.0, G, 15.0])
    runs = jax.jit(jax.vmap(lambda g: thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), g=g)))(
        gravities
    )
    assert np.all(runs.success)
    for i, g in enumerate(gravities):
        alone = thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), g=g)
        count = int(alone.events.count)
        assert int(runs.events.count[i]) == count
        assert_close(runs.events.time[i][:count], alone.events.time[:count], IDENTITY)
        assert_close(runs.q[i], alone.q, SOLVED)


# What is refused, and how runs with events fail.


def spoiled(**fields):
    """A crossing with fields that its own types do not allow."""
    event = rj.Crossing(HEIGHT_OF_BALL)
    for name, value in fields.items():
        object.__setattr__(event, name, value)
    return event


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (spoiled(of="ball.y"), "of = 'ball.y' is no function of .system, t, q, v."),
        (rj.Crossing(HEIGHT_OF_BALL, level=np.nan), "Crossing: level is nan"),
        (spoiled(direction="down"), "direction = 'down' must be 'falling'"),
        (rj.Crossing(lambda system, t, q, v: q), r"events\[0\] gives an array of shape \(3,\)"),
        (rj.Impact(HEIGHT_OF_BALL, restitution=1.1), "restitution = 1.1 must be from 0 to 1"),
        (rj.Impact(rj.quantity.Rate(HEIGHT_OF_BALL)), r"gap of events\[0\] depends on velocities"),
        (rj.Stop(rj.quantity.Coordinate("bal.y")), "no coordinate 'bal.y'"),
    ],
)
def test_wrong_events(event, words):
    with pytest.raises(rj.InputError, match=words):
        thrown(event)


def test_wrong_settings():
    impact = rj.Impact(HEIGHT_OF_BALL)
    with pytest.raises(rj.InputError, match="max_events = 0 must be at least 1"):
        thrown(impact, max_events=0)
    with pytest.raises(rj.InputError, match="events and dense=True need romjax's own integration"):
        jax.grad(lambda g: thrown(impact, g=g, adjoint=diffrax.DirectAdjoint()).q[-1, 1])(G)


def test_more_events_than_there_is_room_for():
    with pytest.raises(rj.SimulationError, match="MAX_EVENTS: more happened than there is room"):
        thrown(rj.Impact(HEIGHT_OF_BALL, restitution=0.8), max_events=2)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_contact_that_lasts_is_refused(restitution):
    """A ball that rests on the ground, at once or after infinitely many impacts in finite time."""
    run = thrown(rj.Impact(HEIGHT_OF_BALL, restitution), throw=False)
    assert run.status == rj.Status.CONTACT_LASTS
    assert "use a romjax.Contact instead" in run.summary()
    assert not np.any(run["ball.y"][np.isfinite(run["ball.y"])] < -SOLVED)
    below = thrown(rj.Impact(HEIGHT_OF_BALL, restitution, level=2 * HEIGHT), throw=False)
    assert below.status == rj.Status.CONTACT_LASTS
    assert "bodies overlap at the start" in below.summary()
