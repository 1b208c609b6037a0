"""Loads that change within a step: the motion of a free body has closed forms."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import DIFFERENCED, SOLVED

import romjax as rj
from romjax.scene.signal import AbstractSignal
from romjax.system.schedule import Schedule, _changes

TS = np.linspace(0.0, 1.0, 11)


def pushed(*signals: AbstractSignal) -> rj.AbstractSystem:
    """A body of 1 kg at rest that a force along x pushes."""
    body = rj.RigidBody("body", 1.0, 1.0)
    forces = [rj.Force(body.at(), (1.0, 0.0), signal) for signal in signals]
    return rj.assemble(rj.Scene([body], effects=forces))


def pulse(start, duration, rise, impulse=1.0) -> rj.Sum:
    """An impulse [N s] that rises and falls in a time of its own."""
    height = impulse / duration
    return rj.Sum((rj.Step(height, start, rise), rj.Step(-height, start + duration, rise)))


def simulate(system, ts, **settings) -> rj.Trajectory:
    """By default settings, but for the balance of energy."""
    return rj.simulate(system, ts, audit=False, **settings)


def end_of(run) -> np.ndarray:
    """Where a body is at the end, and its velocity, along x."""
    return np.array([run.q[-1, 0], run.v[-1, 0]])


@pytest.mark.parametrize("duration", [1e-4, 1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("share", [0.1, 1.0])
def test_a_short_pulse_is_seen(duration, share):
    start = 0.463
    none = pulse(start, 0.1, 0.1, impulse=0.0)  # the program of two, below
    run = simulate(pushed(pulse(start, duration, share * duration), none), TS)
    middle = start + (1 + share) * duration / 2
    np.testing.assert_allclose(end_of(run), [1 - middle, 1.0], rtol=SOLVED)


def test_pulses_of_several_forces_are_seen():
    """Signals of equal structure are stacked."""
    run = simulate(pushed(pulse(0.2, 1e-3, 1e-4), pulse(0.7, 1e-4, 1e-4)), TS)
    middles = 0.2 + 1.1e-3 / 2, 0.7 + 1e-4
    np.testing.assert_allclose(end_of(run), [2 - sum(middles), 2.0], rtol=SOLVED)


def test_a_pulse_in_a_table_is_seen():
    """Its area is that of a triangle; straight on both sides, the table has three corners."""
    times = np.array([0.0, 0.2, 0.31, 0.311, 0.312, 0.6, 1.0])
    system = pushed(rj.Table(times, 1000.0 * (times == 0.311)))
    assert np.sum(np.isfinite(Schedule.of(system).corners(jnp.asarray(TS)))) == 3
    np.testing.assert_allclose(end_of(simulate(system, TS)), [1 - 0.311, 1.0], rtol=SOLVED)


@pytest.mark.parametrize("frequency", [11.0, 101.0, 997.0])
def test_a_fast_sine_is_seen(frequency):
    """It begins with a step from zero: the body drifts with the mean velocity 1 / (2 π f)."""
    run = simulate(pushed(rj.Sine(1.0, frequency)), TS, rtol=1e-8)
    rate = 2 * np.pi * frequency
    velocity = (1 - np.cos(rate)) / rate
    drift = (1 - np.sin(rate) / rate) / rate
    np.testing.assert_allclose(end_of(run), [drift, velocity], atol=DIFFERENCED / rate)


def test_a_chirp_is_seen():
    """The frequency passes zero on the way; against ∫(1 − t) f dt and ∫f dt by Gauss's rule."""
    run = simulate(pushed(rj.Chirp(1.0, -50.0, 100.0)), TS, rtol=1e-9)
    nodes, weights = np.polynomial.legendre.leggauss(300)
    times, pull = (1 + nodes) / 2, weights / 2
    pull *= np.sin(2 * np.pi * 50 * (times**2 - times))
    wanted = [np.sum((1 - times) * pull), np.sum(pull)]
    np.testing.assert_allclose(end_of(run), wanted, atol=DIFFERENCED)


class Silent(AbstractSignal):
    """A pulse in the form of a bell that says nothing of itself."""

    middle: float
    width: float = 1e-2

    def __call__(self, t):
        x = (t - self.middle) / self.width
        return jnp.exp(-(x**2)) / (self.width * jnp.sqrt(jnp.pi))


class Jump(AbstractSignal):
    """A force that begins."""

    start: float

    def __call__(self, t):
        return jnp.where(t < self.start, 0.0, 1.0)

    def corners(self):
        return jnp.asarray(self.start)[None]


class Twice(AbstractSignal):
    """A signal that holds others, in a field and in a list."""

    one: AbstractSignal
    others: list[AbstractSignal]

    def __call__(self, t):
        return self.one(t) + sum(other(t) for other in self.others)


@pytest.mark.instant
@pytest.mark.parametrize("start", [0.5, np.nan])
def test_signals_hold_signals(start):
    signal = Twice(Jump(0.1), [Jump(start)])
    if np.isnan(start):
        with pytest.raises(rj.SceneError, match="'body'.*Jump.start"):
            signal.check("force on 'body'")
    else:
        signal.check("force on 'body'")


def test_steps_with_a_signal_that_says_nothing_end_at_outputs():
    assert not Silent(0.463).is_known
    run = simulate(pushed(Silent(0.463)), np.linspace(0.0, 1.0, 101))
    np.testing.assert_allclose(end_of(run), [1 - 0.463, 1.0], atol=DIFFERENCED)


def test_what_hides_between_two_outputs_is_looked_for():
    """A bell of a hundredth of their distance, which no step of that length sees."""

    @jax.jit
    @jax.vmap
    def end(middle):
        run = simulate(pushed(Silent(middle, 1e-4)), jnp.linspace(0.0, 1.0, 101), throw=False)
        return jnp.stack([run.q[-1, 0], run.v[-1, 0]])

    middles = np.linspace(0.4, 0.5, 64)
    exact = np.stack([1 - middles, np.ones(64)], axis=1)
    np.testing.assert_allclose(end(middles), exact, atol=DIFFERENCED)


def test_only_what_hides_takes_more_steps():
    ts = np.linspace(0.0, 1.0, 101)
    wide, narrow = (
        Schedule.of(pushed(Silent(0.463, x))).seeing(jnp.asarray(ts)) for x in (0.1, 1e-3)
    )
    assert np.sum(wide.hidden) == 0
    assert 3 <= np.sum(narrow.hidden) <= 5


def test_a_signal_of_ones_own_may_say_when_it_changes():
    run = simulate(pushed(Jump(jnp.array(0.463))), TS, rtol=1e-8)
    np.testing.assert_allclose(end_of(run), [0.537**2 / 2, 0.537], rtol=DIFFERENCED)


def test_a_system_of_functions_that_changes_with_time_ends_steps_at_outputs():
    bell = Silent(0.463)
    system = rj.CustomSystem(
        lambda q: jnp.eye(1), lambda t, q, v: bell(t)[None], q0=np.zeros(1), v0=np.zeros(1)
    )
    assert not Schedule.of(system).is_known
    run = simulate(system, np.linspace(0.0, 1.0, 101))
    np.testing.assert_allclose(end_of(run), [1 - 0.463, 1.0], atol=DIFFERENCED)
    hidden = Schedule.of(system).seeing(jnp.linspace(0.0, 1.0, 11)).hidden
    assert hidden.tolist() == [False] * 3 + [True] * 3 + [False] * 4


@pytest.mark.parametrize("name", ["four_bar", "flywheel", "vehicle_axle", "robot_arm"])
def test_parts_change_with_time_by_their_signals_only(name):
    """What else changes would need outputs as corners; parts of romjax are not asked."""
    system = rj.assemble(getattr(rj.gallery, name)())
    schedule = Schedule.of(system)
    assert schedule.is_known
    assert schedule.stacked
    assert not _changes(system)


def ends(start, duration):
    """Of a pulse that falls as it rises."""
    run = simulate(pushed(pulse(start, duration, duration)), TS, throw=False)
    return jnp.stack([run.q[-1, 0], run.v[-1, 0]])


def test_a_table_is_differentiable_by_its_times():
    """Its slope jumps there, and so does its derivative by them, which each step needs from its own
    side. Of x(1) = ∫ F (1 − t) dt by when a rise of 0.1 s to 5 N begins, which falls to 2 N at 1 s.
    """

    def place(start):
        times = jnp.stack([0 * start, start, start + 0.1, 1.0 + 0 * start])
        table = rj.Table(times, jnp.array([0.0, 0.0, 5.0, 2.0]))
        return simulate(pushed(table), TS, solver=diffrax.Dopri8()).q[-1, 0]

    with rj.forward_mode():
        found = jax.jit(jax.jacfwd(place))(0.37)
    np.testing.assert_allclose(found, -5 * 0.58 + 0.53, rtol=1e-9)


@pytest.mark.slow
def test_a_pulse_is_differentiable_and_batchable_by_its_corners():
    """At the end, x = 1 − start − duration and v = 1."""
    starts, durations = np.array([0.2, 0.463, 0.8]), np.array([1e-3, 1e-2, 1e-4])
    batch = jax.jit(jax.vmap(ends))(starts, durations)
    exact = np.stack([1 - starts - durations, np.ones(3)], axis=1)
    np.testing.assert_allclose(batch, exact, rtol=SOLVED)
    slopes = jax.jit(jax.jacrev(ends, argnums=(0, 1)))(0.463, 1e-2)
    np.testing.assert_allclose(slopes, [[-1.0, 0.0], [-1.0, 0.0]], atol=DIFFERENCED)


class OwnSine(AbstractSignal):
    """A user's signal, which has no numbers."""

    def __call__(self, t):
        return jnp.sin(t)


def test_a_signal_of_a_users_own_without_numbers():
    """The way t - sin t of a kilogram, and half of it of two."""
    body = rj.RigidBody("body", 1.0, 1.0)
    other = rj.RigidBody("other", 2.0, 1.0)
    forces = [rj.Force(one.at(), (1.0, 0.0), OwnSine()) for one in (body, other)]
    run = simulate(rj.assemble(rj.Scene([body, other], effects=forces)), TS)
    assert_close(run["body.x"], TS - np.sin(TS), SOLVED)
    assert_close(run["other.x"], (TS - np.sin(TS)) / 2, SOLVED)
