"""Events: when quantities pass their levels, and the derivatives of these times."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from comparison import assert_close
from groups import in_groups
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import GRAVITY, RODAS5P, TIGHT, bar, bars, oscillator, run, system

import romjax as rj
from romjax.events.search import first_crossing

TS = np.linspace(0.0, 3.0, 31)
HEIGHT, G, MASS = 1.0, 9.81, 1.3


class Weight(eqx.Module):
    """The force of gravity, whose acceleration is a parameter."""

    g: jax.Array

    def __call__(self, t, q, v):
        return -MASS * self.g * jnp.ones(1)


def mass(q):
    return MASS * jnp.eye(1)


def falling(g=G) -> rj.CustomSystem:
    """A ball that is dropped, in one coordinate."""
    return rj.CustomSystem(mass, Weight(jnp.asarray(g)), q0=[HEIGHT], v0=[0.0])


def height(system, t, q, v):
    return q[0]


def speed(system, t, q, v):
    return v[0]


def both(system, t, q, v):
    return jnp.append(q, v)


def thrown(*events, g=G, **settings):
    return run(falling(g), TS, events=events, **settings)


def bounces(count, g=G, restitution=0.8):
    """The times of the first impacts of a ball that is dropped."""
    first = jnp.sqrt(2 * HEIGHT / g)
    return first * (1 + 2 * sum(restitution**k for k in range(1, count)))


# Times.


def bouncing(made, y):
    """That a run of a ball with impacts, whose height is the coordinate `y`, is the exact one."""
    events = made.events
    count = int(events.count)
    assert count == 6
    assert_close(events.times(), [bounces(k + 1) for k in range(count)], SOLVED)
    speeds = np.sqrt(2 * G * HEIGHT) * 0.8 ** np.arange(count)
    assert_close(events.v_before[:count, y], -speeds, SOLVED)
    assert_close(events.v_after[:count, y], 0.8 * speeds, SOLVED)
    assert_close(events.impulse[:count, 0], MASS * 1.8 * speeds, SOLVED)
    assert np.all(np.isinf(np.asarray(events.time)[count:]))
    # At the outputs, the flight after the last impact before.
    flights = np.searchsorted(events.times(), TS) - 1
    after = TS - events.times()[flights]
    rising = 0.8 * speeds[flights] * after - 0.5 * G * after**2
    assert_close(made.q[:, y], np.where(flights < 0, HEIGHT - 0.5 * G * TS**2, rising), SOLVED)


def test_a_bouncing_ball():
    """A body in the plane, and its travel against the ground."""
    ball = rj.RigidBody("ball", MASS, 0.1, position=(0.0, HEIGHT))
    travel = rj.quantity.Travel(ball.at(), rj.ground.at(angle=np.pi / 2))
    scene = rj.Scene([ball], effects=[rj.Gravity((0.0, -G))])
    made = run(rj.assemble(scene), TS, events=[rj.Impact(travel, restitution=0.8)])
    bouncing(made, 1)
    assert made.is_valid


# A stiff method, and one whose stages are found by iteration.
@pytest.mark.parametrize(
    "solver",
    in_groups([RODAS5P, diffrax.Kvaerno5()], slow=[RODAS5P]),
    ids=["Rodas5P", "Kvaerno5"],
)
def test_a_bouncing_ball_by_implicit_methods(solver):
    bouncing(thrown(rj.Impact(height, restitution=0.8), solver=solver), 0)


NEVER = -1e3  # [m, m/s]


def watched(level=NEVER, stop=NEVER, turn=NEVER, impact=(0.9, 0.0), **settings):
    """A ball that bounces with a restitution at a level, what is watched, and where it ends."""
    return thrown(
        rj.Impact(height, *impact),
        rj.Crossing(height, level=level),
        rj.Crossing(height, level=level, direction="rising"),
        rj.Crossing(speed, level=turn, direction="falling"),
        rj.Crossing(height, level=2.0),
        rj.Stop(height, level=stop),
        **settings,
    )


def test_directions_and_levels():
    """On its way a ball rises and falls through one height, and turns where its speed is zero."""
    made = watched(level=0.3, turn=0.0)
    events = made.events
    assert [len(events.times(i)) for i in range(6)] == [4, 8, 4, 4, 0, 0]
    assert np.all(np.diff(np.asarray(events.time)[: int(events.count)]) > 0)
    assert_close(events.times(2), events.times(1)[1::2], SOLVED)
    # The apex lies between the passages upwards and downwards.
    assert_close(events.times(3)[:3], (events.times(1)[1:6:2] + events.times(1)[2:8:2]) / 2, SOLVED)
    q, happened = (np.asarray(x)[: int(events.count)] for x in (events.q, events.happened))
    assert_close(q[happened[:, 1], 0], 0.3, SOLVED)
    assert made.is_valid


def test_a_stop():
    """The run ends there, and so do its outputs."""
    made = watched(level=0.5, stop=0.3, turn=0.0)
    time = np.sqrt(2 * 0.7 / G)
    later = time < TS
    assert_close(made.t, np.where(later, time, TS), SOLVED)
    assert_close(np.asarray(made.q)[later, 0], 0.3, SOLVED)
    assert_close(np.asarray(made.v)[later, 0], -G * time, SOLVED)
    assert made.is_valid
    assert [len(made.events.times(i)) for i in (0, 1, 5)] == [0, 1, 1]


def flight(impact=-1.0, stop=-1.0) -> rj.Trajectory:
    """A body that moves freely past x = 1/2, in steps that are as long as they may be; the levels
    of the wall that throw it back and that end the run.
    """
    system = rj.assemble(rj.Scene([rj.RigidBody("body", 1.0, 1.0, velocity=(1.0, 0.0))]))
    events = [
        rj.Crossing(wall),
        rj.Crossing(shallow),
        rj.Impact(wall, restitution=0.5, level=impact),
        rj.Stop(wall, level=stop),
    ]
    return rj.simulate(system, np.linspace(0.0, 1.0, 3), events=events, audit=False)


def wall(system, t, q, v):
    """How far a body is from a wall of one centimetre."""
    return jnp.abs(q[0] - 0.5) - 0.005


def shallow(system, t, q, v):
    """A smooth quantity that is negative for nine milliseconds."""
    return (q[0] - 0.3712) * (q[0] - 0.3802)


def test_excursions_within_a_step_are_seen():
    run = flight()
    np.testing.assert_allclose(run.events.times(0), [0.495, 0.505], rtol=SOLVED)
    np.testing.assert_allclose(run.events.times(1), [0.3712, 0.3802], rtol=SOLVED)
    assert run.stats.num_steps < 20


def test_a_body_stops_at_a_thin_wall():
    run = flight(stop=0.0)
    np.testing.assert_allclose(run.q[-1, 0], 0.495, rtol=SOLVED)


def test_a_body_is_thrown_back_by_a_thin_wall():
    run = flight(impact=0.0)
    np.testing.assert_allclose(run.events.times(2), [0.495], rtol=SOLVED)
    np.testing.assert_allclose(run.v[-1, 0], -0.5, rtol=SOLVED)


@pytest.mark.slow
def test_the_period_of_a_pendulum():
    """By the complete elliptic integral of the first kind."""
    length, swing = 0.9, 1.2  # swing: the amplitude [rad], against hanging
    pendulum = rj.assemble(bar(2.0, length, angle=swing - np.pi / 2))
    quarter = np.sqrt(2 * length / (3 * G)) * scipy.special.ellipk(np.sin(swing / 2) ** 2)
    wanted = quarter * np.arange(1, 9, 2)
    passes = rj.Crossing(rj.quantity.Coordinate("bar1.phi"), level=-np.pi / 2)
    ts = np.linspace(0.0, 8 * quarter, 50)
    made = run(pendulum, ts, events=[passes])
    assert_close(made.events.times(), wanted, SOLVED)


@pytest.mark.slow
def test_all_events_of_a_chaotic_motion():
    """Those that a search of dense output on a fine grid finds, and no others."""
    chaotic = system(bars)
    rng = np.random.default_rng(5)
    labels = [rng.choice(chaotic.structure.labels) + rng.choice(["", "'"]) for _ in range(8)]
    quantities = [rj.quantity.Coordinate(label) for label in labels]
    ts = np.linspace(0.0, 3.0, 61)
    # Steps that end at events are others, and the motion amplifies what they err by.
    free = run(chaotic, ts, rtol=TIGHT / 10)
    levels = [float(rng.choice(np.asarray(free[label])[1:-1])) for label in labels]
    crossings = [rj.Crossing(of, level) for of, level in zip(quantities, levels, strict=True)]
    made = run(chaotic, ts, events=crossings, dense=True, rtol=TIGHT / 10)
    assert_close(made.q, free.q, SOLVED)
    fine = np.linspace(0.0, 3.0, 20_001)[1:-1]
    between = made.at(fine)
    total = 0
    for i, (label, level) in enumerate(zip(labels, levels, strict=True)):
        above = np.asarray(between[label]) > level
        before = np.flatnonzero(above[1:] != above[:-1])
        times = made.events.times(i)
        assert len(times) == len(before)
        assert np.all((times > fine[before] - SOLVED) & (times < fine[before + 1] + SOLVED))
        total += len(times)
    assert total > 20
    assert_close(made.at(made.events.time[:total]).q, made.events.q[:total], 10 * SOLVED)


# Derivatives.


def fifth(g, restitution, **settings):
    """The time of the fifth impact, and the run."""
    made = thrown(rj.Impact(height, restitution), g=g, **settings)
    return made.events.time[4], made


@jax.jit
@jax.grad
def slopes(numbers):
    """Of the times of the fifth impact by gravity and restitution, in closed form."""
    return bounces(5, *numbers)


@pytest.mark.slow
def test_derivatives_of_the_fifth_impact_in_forward_mode():
    with rj.forward_mode():
        found = jax.jit(jax.jacfwd(lambda *x: fifth(*x)[0], (0, 1)))(G, 0.8)
    assert_close(found, slopes((G, 0.8)), SOLVED)


def test_fixed_steps_end_at_events():
    """And go on in their grid; with derivatives in forward mode."""
    with rj.forward_mode():
        by = jax.jacfwd(functools.partial(fifth, dt=0.05), (0, 1), has_aux=True)
        found, made = jax.jit(by)(G, 0.8)
    assert_close(found, slopes((G, 0.8)), SOLVED)
    assert_close(made.events.times(), [bounces(k + 1) for k in range(6)], SOLVED)
    assert int(made.stats.num_accepted_steps) == 60 + 6


@pytest.mark.slow
def test_derivatives_where_a_step_ends_just_before_an_impact():
    """The next one, up to the impact, is so short that what is left of the gap is rounding."""
    g = 2 * HEIGHT / (0.45 + 1e-10) ** 2

    def first(g):
        return thrown(rj.Impact(height, restitution=0.8), g=g, dt=0.05).events.time[0]

    with rj.forward_mode():
        found = jax.jit(jax.jacfwd(first))(g)
    assert_close(found, -0.5 * bounces(1, g) / g, SOLVED)


@pytest.mark.slow
def test_lanes_have_events_and_derivatives_of_their_own():
    """In reverse mode, each lane like the run alone."""
    gravities = np.array([8.0, G, 15.0])
    by = jax.value_and_grad(fifth, (0, 1), has_aux=True)
    (_, made), found = jax.jit(jax.vmap(by, (0, None)))(gravities, 0.8)
    assert np.all(np.asarray(made.success))
    lanes = [np.asarray(x) for x in (*found, made.events.count, made.events.time, made.q)]
    for g, *slope, lane, times, q in zip(gravities, *lanes, strict=True):
        assert_close(slope, slopes((g, 0.8)), SOLVED)
        alone = thrown(rj.Impact(height, 0.8), g=g)
        count = int(alone.events.count)
        assert lane == count
        assert_close(times[:count], np.asarray(alone.events.time)[:count], IDENTITY)
        assert_close(q, alone.q, SOLVED)


@pytest.mark.slow
def test_derivatives_after_impacts_and_at_a_stop():
    """Of states beyond events, which move with their times."""

    def ends(g):
        stop = rj.Stop(speed, level=-2.0, direction="falling")
        # After the first impact the ball is slower than 2 m/s, until it falls again.
        made = thrown(rj.Impact(height, restitution=0.8), stop, g=g)
        between = 7  # of the output times, after the impact and before the stop
        return jnp.stack([made.q[between, 0], made.v[between, 0], made.t[-1], made.q[-1, 0]])

    slope = jax.jit(jax.jacrev(ends))(G)
    step = 1e-5
    differences = (ends(G + step) - ends(G - step)) / (2 * step)
    assert_close(slope, differences, DIFFERENCED, scale=1 + jnp.abs(differences))


@pytest.mark.slow
def test_derivatives_where_a_contact_lasts():
    """Of the fall, and none of outputs after it, since the ball stays on the ground."""

    def heights(g):
        made = thrown(rj.Impact(height, restitution=0.0), g=g, throw=False)
        return made.q[jnp.array([2, -1]), 0]

    found = jax.jit(jax.jacrev(heights))(G)
    assert_close(found[0], -0.5 * TS[2] ** 2, SOLVED)
    assert np.isnan(found[1])


# What is refused, and how runs with events fail.


def spoiled(**fields):
    """A crossing with fields that its own types do not allow."""
    event = rj.Crossing(height)
    for name, value in fields.items():
        object.__setattr__(event, name, value)
    return event


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (spoiled(of="ball.y"), "of = 'ball.y' is no function of .system, t, q, v."),
        (spoiled(of=lambda t, q, v: q[1]), "is no function of .system, t, q, v."),
        (rj.Crossing(height, level=np.nan), "Crossing: level is nan"),
        (spoiled(direction="down"), "direction = 'down' must be 'falling'"),
        (rj.Crossing(both), r"events\[0\] gives an array of shape \(2,\)"),
        (rj.Impact(height, restitution=1.1), "restitution = 1.1 must be from 0 to 1"),
        (rj.Impact(speed), r"gap of events\[0\] depends on velocities"),
        (rj.Stop(rj.quantity.Coordinate("bal.y")), "no coordinate 'bal.y'"),
    ],
)
def test_wrong_events(event, words):
    with pytest.raises(rj.InputError, match=words):
        thrown(event)


def test_wrong_settings():
    impact = rj.Impact(height)
    with pytest.raises(rj.InputError, match="max_events = 0 must be at least 1"):
        thrown(impact, max_events=0)


def test_more_events_than_there_is_room_for():
    """There is room for 256; from a low height a ball bounces 26 times a second, and more."""
    with pytest.raises(rj.SimulationError, match="MAX_EVENTS: more happened than there is room"):
        watched(impact=(1.0, HEIGHT - 1e-4))


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_contact_that_lasts_is_refused(restitution):
    """A ball that rests on the ground, at once or after infinitely many impacts in finite time."""
    made = watched(impact=(restitution, 0.0), throw=False)
    assert made.status == rj.Status.CONTACT_LASTS
    assert "use a romjax.Contact instead" in made.summary()
    heights = np.asarray(made.q)[:, 0]
    assert not np.any(heights[np.isfinite(heights)] < -SOLVED)
    assert np.array_equal(np.isnan(heights), np.max(made.events.times()) < TS)
    below = watched(impact=(restitution, 2 * HEIGHT), throw=False)
    assert below.status == rj.Status.CONTACT_LASTS
    assert "bodies overlap at the start" in below.summary()


def test_events_of_a_body_that_turns_are_all_seen():
    """A free flight has no error that bounds its steps: between two of them it turns many times."""
    spin, high, level = 317.0, 4.0, 0.8
    start = {"position": (0.0, high), "angular_velocity": spin}
    stick = rj.RigidBody("stick", 1.0, 1.0, **start)
    system = rj.assemble(rj.Scene([stick], effects=[rj.Gravity()]))

    def above(system, t, q, v):
        return q[1] + 0.5 * jnp.sin(q[2]) - level

    run = rj.simulate(system, np.linspace(0.0, 1.0, 5), events=[rj.Crossing(above)], audit=False)
    times = np.linspace(0.0, 1.0, 1_000_001)
    heights = high - 0.5 * GRAVITY * times**2 + 0.5 * np.sin(spin * times) - level
    (crossed,) = np.nonzero(np.diff(np.sign(heights)))
    np.testing.assert_allclose(run.events.times(0), times[crossed], atol=DIFFERENCED)


def test_oscillations_in_step_with_the_nodes_are_no_rest():
    """At equal parts of the step, 34 periods each, the quantity is the same."""
    one, both = jnp.ones(1), jnp.ones(1, bool)

    def quantity(share):
        return 0.5 + jnp.cos(2 * jnp.pi * 8 * 34 * share)[None]

    found = jax.jit(lambda: first_crossing(quantity, one, 1.5 * one, 1e-14 * one, both, both))()
    assert not found.is_resolved


def test_functions_of_reduced_coordinates_are_refused():
    """They would watch another motion, in silence."""
    full = oscillator(frequencies=(2.0, 3.0), q0=[0.0, 0.0], v0=[0.0, 1.0])
    rom = rj.reduce(full, rj.Basis.from_modes(np.eye(2)[:, 1:], np.zeros(2)), rj.Galerkin())
    for event in (rj.Stop(height, 0.5), rj.Crossing(speed, 0.5)):
        with pytest.raises(rj.InputError, match=r"events\[1\] watches gives .*system.state"):
            rj.simulate(rom, TS, events=[rj.Crossing(last_height, 0.1), event])


def last_height(system, t, q, v):
    return system.state(t, q, v).q[1]
