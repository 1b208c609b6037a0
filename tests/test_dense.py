"""Dense output: a run between its outputs is what a run with outputs there is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import RODAS5P, Stiffness, bar, bars, point_pendulum, run, system, unit_circle, unit_mass

import romjax as rj

TS, FINE = np.linspace(0.0, 0.5, 3), np.linspace(0.05, 0.45, 17)
BAR = rj.assemble(bar())


@pytest.mark.parametrize(
    ("system", "settings"),
    [
        pytest.param(BAR, {"stabilization": rj.Projection()}, marks=pytest.mark.slow),
        (point_pendulum(), {"solver": RODAS5P}),
    ],
    ids=["Dopri8 projected", "Rodas5P"],
)
def test_between_the_outputs(system, settings):
    made = run(system, TS, dense=True, **settings)
    ts = np.concatenate([TS[:1], FINE, TS[-1:]])
    wanted = run(system, ts, **settings)
    between = made.at(FINE)
    for actual, other in (
        (between.q, wanted.q),
        (between.v, wanted.v),
        (between.multipliers, wanted.multipliers),
    ):
        other = np.asarray(other)
        assert_close(actual, other[1:-1], IDENTITY, scale=1 + np.max(np.abs(other)))
    assert_close(made.at(TS).q, made.q, IDENTITY)
    if system is BAR:
        position = rj.measure(BAR, between, bar().bodies[0].at()).position
        assert_close(position, np.asarray(between.q)[:, :2], IDENTITY)


@pytest.mark.slow
def test_of_a_reduced_model_with_charts():
    """Times in several charts, between changes of the chart."""
    ts = np.linspace(0.0, 2.0, 41)
    training = run(system(bars), ts)
    rom = rj.reduce(system(bars), rj.pod(training, rank=4), rj.Minimal())
    made = run(rom, ts[[0, 40]], dense=True)
    assert_close(made.at(ts).q, run(rom, ts).q, SOLVED)


@pytest.mark.slow
def test_derivatives_between_the_outputs():
    """In reverse mode, by the start and by the frequency: cos ωt and −t sin ωt, times the start."""

    @jax.jit
    @jax.grad
    def slopes(numbers):
        start, stiffness = numbers
        force = Stiffness(stiffness[None], jnp.zeros(1))
        free = rj.CustomSystem(unit_mass, force, q0=start[None], v0=[0.0])
        return run(free, TS, dense=256, throw=False).at(FINE).q[8, 0]

    start, omega, t = 0.7, 3.0, FINE[8]
    wanted = np.cos(omega * t), -start * t * np.sin(omega * t) / (2 * omega)
    assert_close(slopes((jnp.asarray(start), jnp.asarray(omega**2))), wanted, DIFFERENCED)


@pytest.mark.slow
def test_derivatives_without_jit():
    """Of a point on a circle at a speed s: its angle goes with s t, and what holds it with s²."""

    def between(speed):
        start = {"q0": [1.0, 0.0], "v0": jnp.stack([0 * speed, speed])}
        free = rj.CustomSystem(unit_mass, lambda t, q, v: 0 * q, unit_circle, **start)
        made = run(free, TS, dense=256, throw=False).at(FINE)
        return jnp.arctan2(made.q[8, 1], made.q[8, 0]), made.multipliers[8, 0]

    speed = jnp.asarray(0.7)
    of_angle, of_force = jax.jacrev(between)(speed)
    assert_close(of_angle, FINE[8], DIFFERENCED)
    assert_close(of_force, 2 * between(speed)[1] / speed, DIFFERENCED)


def test_what_is_refused():
    pendulum, solver = point_pendulum(), RODAS5P
    made = run(pendulum, TS, dense=True, solver=solver)
    with pytest.raises(rj.InputError, match=r"times\[1\] = 0.6 s lies outside of the run, from 0"):
        made.at(np.array([0.1, 0.6]))
    with pytest.raises(rj.InputError, match="simulate it with dense=True"):
        run(pendulum, TS, solver=solver).at(FINE)
    with pytest.raises(rj.SimulationError, match="MAX_STEPS"):
        run(pendulum, TS, dense=4, solver=solver)
