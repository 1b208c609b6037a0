"""Dense output: a run between its outputs is what a run with outputs there is."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj

TS, FINE = jnp.linspace(0.0, 0.5, 3), jnp.linspace(0.05, 0.45, 17)


@pytest.fixture(scope="module")
def chain():
    return rj.assemble(rj.gallery.chain(2))


@pytest.mark.parametrize(
    ("solver", "stabilization"),
    [
        pytest.param(diffrax.Dopri8(), rj.Projection(), marks=pytest.mark.slow),
        (rj.Rodas5P(), "default"),
    ],
    ids=["Dopri8 projected", "Rodas5P"],
)
def test_between_the_outputs(chain, solver, stabilization):
    settings = {"solver": solver, "stabilization": stabilization}
    run = rj.simulate(chain, TS, dense=True, **settings)
    wanted = rj.simulate(chain, jnp.concatenate([TS[:1], FINE, TS[-1:]]), **settings)
    between = run.at(FINE)
    for actual, other in (
        (between.q, wanted.q),
        (between.v, wanted.v),
        (between.multipliers, wanted.multipliers),
    ):
        assert_close(actual, other[1:-1], IDENTITY, scale=1 + jnp.max(jnp.abs(other)))
    assert_close(run.at(TS).q, run.q, IDENTITY)
    tip = rj.gallery.chain(2).bodies[-1].at()
    assert_close(rj.measure(chain, between, tip).position, between.q[:, 3:5], IDENTITY)


def test_of_a_reduced_model_with_charts(chain):
    """Times in several charts, between changes of the chart."""
    training = rj.simulate(chain, jnp.linspace(0.0, 2.0, 101), rtol=TIGHT)
    rom = rj.reduce(chain, rj.pod(training, rank=4), rj.Minimal())
    ts = jnp.linspace(0.0, 2.0, 41)
    run = rj.simulate(rom, ts[jnp.array([0, 40])], dense=True, rtol=TIGHT)
    assert_close(run.at(ts).q, rj.simulate(rom, ts, rtol=TIGHT).q, SOLVED)


@pytest.mark.slow
def test_derivatives_between_the_outputs(chain):
    """In reverse mode, by the start."""

    def height(q0):
        run = rj.simulate(chain, TS, q0=q0, dense=256, rtol=TIGHT, throw=False)
        return run.at(FINE).q[8, 4]

    direction = rj.consistent(chain, chain.q0, jnp.arange(6.0))[1]
    slope = jax.jit(jax.grad(height))(chain.q0) @ direction
    step = 1e-4  # the step size control makes the height jump by its tolerance
    q0 = [rj.consistent(chain, chain.q0 + sign * step * direction)[0] for sign in (1, -1)]
    assert_close(slope, (height(q0[0]) - height(q0[1])) / (2 * step), 10 * DIFFERENCED)


def test_what_is_refused(chain):
    run = rj.simulate(chain, TS, dense=True)
    with pytest.raises(rj.InputError, match=r"times\[1\] = 0.6 s lies outside of the run, from 0"):
        run.at(np.array([0.1, 0.6]))
    with pytest.raises(rj.InputError, match="simulate it with dense=True"):
        rj.simulate(chain, TS).at(FINE)
    with pytest.raises(rj.SimulationError, match="MAX_STEPS"):
        rj.simulate(chain, TS, dense=4)
