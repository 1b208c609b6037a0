"""Motions of any size with nothing set: a spring, a beam, and a linkage in millimetres."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parallelogram import parallelogram
from scipy.integrate import solve_ivp

import romjax as rj

TS = np.linspace(0.0, 5.0, 101)
# Required: errors in tolerances of the size of the motion.
ERROR = 100 * 1e-6


def spring(amplitude, at=0.0) -> rj.AbstractSystem:
    """A body on a spring, which vibrates by 10 rad/s about a point."""
    body = rj.RigidBody("body", 1.0, 1.0, position=(at + amplitude, 0.0))
    anchor = rj.ground.at((at - 1.0, 0.0))
    return rj.assemble(rj.Scene([body], effects=[rj.Spring(body.at(), anchor, 100.0, 1.0)]))


def middle(system, t, q, v):
    return q[0]


@pytest.mark.parametrize(
    ("amplitude", "at"), [(1e-9, 0.0), (1e-6, 0.0), (1e-3, 0.0), (0.1, 0.0), (1e-3, 100.0)]
)
def test_a_vibration_of_any_size_is_right(amplitude, at):
    """Also far from the origin."""
    run = rj.simulate(spring(amplitude, at), TS)
    assert run.is_valid
    error = np.abs(run.q[:, 0] - at - amplitude * np.cos(10 * TS))
    assert np.max(error) <= ERROR * amplitude


def test_what_rounding_moves_takes_long_steps():
    """A load and a spring in balance but for rounding, whose errors no step can lessen."""
    body = rj.RigidBody("body", 0.7, 1.0, position=(0.0, 0.5))
    tie = rj.Spring(body.at(), rj.ground.at((0.0, 1.3)), 100.0, 0.8 - 0.7 * 9.81 / 100.0)
    run = rj.simulate(rj.assemble(rj.Scene([body], effects=[rj.Gravity(), tie])), TS)
    assert run.is_valid
    assert run.stats.num_steps <= 30


@pytest.mark.slow
def test_a_small_vibration_is_right_by_root_finders_of_diffrax():
    """Their tolerances are of metres: such a run is repeated with finer ones, whatever turns."""
    size, k, end = 1e-6, 100.0, 2.0
    body = rj.RigidBody("body", 1.0, 1.0, position=(size, 0.0))
    spring = rj.Spring(body.at(), rj.ground.at(), k, 0.0, cubic=k / size**2)
    ts = np.linspace(0.0, end, 101)
    run = rj.simulate(
        rj.assemble(rj.Scene([body], effects=[spring])), ts, solver=diffrax.Kvaerno5()
    )
    assert run.is_valid
    true = solve_ivp(
        lambda t, y: [y[1], -k * (y[0] + y[0] ** 3)], (0.0, end), [1.0, 0.0], t_eval=ts,
        rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert np.max(np.abs(run.q[:, 0] / size - true.y[0])) <= ERROR


@pytest.mark.slow
def test_a_small_deflection_of_a_beam_is_right():
    """Its frame is welded: nothing moves by metres."""
    beam = rj.Beam("beam", mass=1.0, length=1.0, frequencies=[2.0], amplitudes=[1e-6])
    system = rj.assemble(rj.Scene([beam], [rj.Weld(beam.at(), rj.ground.at())]))
    (rate,) = np.asarray(rj.modes(system).frequencies)
    q, _ = rj.consistent(system)
    amplitude = float(q[3])
    run = rj.simulate(system, TS, q0=q)
    assert run.is_valid
    assert np.max(np.abs(run.q[:, 3] - amplitude * np.cos(rate * TS))) <= ERROR * amplitude


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_a_mechanism_of_any_size_moves_alike(size):
    """Times are as the square roots of lengths. The audit repeats runs that leave the position in
    which all bars are along one line on another branch, of which the steps decide.
    """

    def moved(size):
        scene = parallelogram(crank=1.2 * size, coupler=2.0 * size, speed=0.9 * np.sqrt(size))
        times = np.linspace(0.0, 3.0, 31) * np.sqrt(size)
        return rj.simulate(rj.assemble(scene), times)

    error = np.max(np.abs(moved(size).q / size - moved(1.0).q))
    assert error <= ERROR


@pytest.mark.slow
def test_the_amplitudes_of_a_beam_of_any_size_are_right():
    """On a hinge that swings. Amplitudes are in m kg^½: those of a millimetre and a microgram are
    far below the tolerance of an angle.
    """

    def end(length, mass):
        beam = rj.Beam("beam", mass, length, EI=30 * mass * length**3, modes=2)
        hinge = beam.at("start"), rj.ground.at()
        beam = beam.placed("start", rj.ground.pose((0.0, 0.0)))
        swing = rj.PrescribedAngle(*hinge, rj.Sine(0.5, 1.0))
        scene = rj.consistent_scene(rj.Scene([beam], [rj.Revolute(*hinge), swing]))
        system = rj.assemble(scene)
        moved = rj.simulate(system, np.linspace(0.0, 2.0, 41), audit=False)
        return np.asarray(rj.measure(system, moved, beam.at("end")).position) / length

    expected = end(1.0, 1.0)
    for length, mass in ((1e-3, 1e-9), (1e-2, 1e-4)):
        assert np.max(np.abs(end(length, mass) - expected)) <= ERROR


def test_what_doubles_cannot_resolve_is_told():
    with pytest.warns(UserWarning, match="tolerances are hardly smaller than the motion"):
        run = rj.simulate(spring(1e-10, at=1.0), TS)
    assert run.flags == rj.Flag.RESOLUTION


def test_rounding_that_adds_up_is_told():
    """A micrometre at a kilometre from the origin, for some cycles and for many."""
    few = rj.simulate(spring(1e-6, at=1000.0), TS)
    assert few.is_valid
    with pytest.warns(UserWarning, match="tolerances are hardly smaller than the motion"):
        many = rj.simulate(spring(1e-6, at=1000.0), 10 * TS)
    for run, least, most in ((few, 0.0, ERROR), (many, ERROR, 10 * ERROR)):
        displacement = run.q[:, 0] - 1000.0
        exact = displacement[0] * np.cos(10 * run.t)
        # In ways of the motion, from one side to the other.
        assert least <= np.max(np.abs(displacement - exact)) / 2e-6 <= most


def test_given_tolerances_are_kept():
    with pytest.warns(UserWarning, match="Choose rtol and atol"):
        run = rj.simulate(spring(1e-4), TS, rtol=1e-6, atol=1e-6, audit=False)
    assert float(run.stats.atol) == 1e-6


def test_a_body_at_rest_is_resolved():
    assert rj.simulate(spring(0.0, at=1.0), TS).is_valid


def test_lanes_of_any_size_are_right():
    """Also where nothing can be repeated, and one lane rests."""
    sizes = np.array([0.0, 1e-9, 1e-6, 1e-3, 0.1])
    runs = jax.jit(jax.vmap(lambda x: rj.simulate(spring(x), TS, throw=False)))(jnp.asarray(sizes))
    assert runs.success.all()
    assert runs.is_valid.all()
    errors = np.max(np.abs(runs.q[..., 0] - sizes[:, None] * np.cos(10 * TS)), axis=1)
    assert np.all(errors <= ERROR * sizes)


@pytest.mark.slow
def test_lanes_see_events_of_any_size():
    """Also those of a body that rests at the level."""
    sizes = jnp.array([0.0, 1e-9, 1e-6, 0.1])

    @jax.jit
    @jax.vmap
    def swing(x):
        return rj.simulate(spring(x), TS, events=[rj.Crossing(middle)], throw=False)

    runs = swing(sizes)
    assert runs.is_valid.tolist() == [True] * 4
    assert runs.events.count.tolist() == [0, 16, 16, 16]
    exact = np.pi / 10 * (np.arange(16) + 0.5)
    np.testing.assert_allclose(runs.events.time[1:, :16], np.tile(exact, (3, 1)), atol=ERROR)


@pytest.mark.slow
def test_a_motion_that_ends_where_it_began_is_resolved():
    """From a level back to it, as of Poincaré's maps: the outputs show no distance."""
    back = rj.Stop(middle, level=0.1)
    run = rj.simulate(spring(0.1), TS[[0, -1]], v0=np.array([1.0, 0.0, 0.0]), events=[back])
    assert run.is_valid
    np.testing.assert_allclose(run.t[-1], np.pi / 20, atol=ERROR)


@pytest.mark.slow
def test_lanes_tell_where_lengths_count():
    """The root finders of implicit methods know tolerances in metres only."""

    def swing(x):
        system, solver = spring(x), diffrax.Kvaerno5()
        run = rj.simulate(system, TS, solver=solver, max_steps=4096, throw=False, audit=False)
        return run.is_valid

    assert jax.jit(jax.vmap(swing))(jnp.array([0.0, 1e-9, 0.1])).tolist() == [True, False, True]
