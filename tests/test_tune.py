"""Baumgarte's parameters by gradient."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from groups import in_groups
from mechanisms import RK4
from zoo import GRAVITY, four_bar, point_pendulum, run, unit_mass

import romjax as rj

# Required: how near to 1.6 ω and ω², and how much more accurate than the start.
NEAR, BETTER = 0.2, 30
# Required of mechanisms: less drift than without stabilisation, in no more steps.
LESS, STEPS = 10, 1.1


@pytest.fixture(scope="module")
def pendulum() -> rj.CustomSystem:
    return point_pendulum()


@pytest.mark.filterwarnings("ignore:The stabilisation and not the mechanism")
@pytest.mark.parametrize("step", in_groups([0.02, 0.005], slow=[0.02]))
def test_a_pendulum_leads_to_its_own_frequency(pendulum, step):
    """Independent of the step, from a start that is ten times off; and less drift than without."""
    ts = np.linspace(0.0, 2.0, round(2 / step) + 1)
    start = rj.Baumgarte(50.0, 625.0)
    found = rj.tune_baumgarte(pendulum, ts, start=start, solver=RK4(), dt=step)
    assert abs(found.best.beta / GRAVITY - 1) <= NEAR
    assert abs(found.best.alpha / (1.6 * GRAVITY**0.5) - 1) <= NEAR
    long = np.linspace(0.0, 10.0, 101)
    truth = run(pendulum, long, rtol=1e-12, stabilization=rj.Projection())
    bare, before, after = (
        run(pendulum, long, solver=RK4(), dt=step, stabilization=pair)
        for pair in (rj.Baumgarte(0.0, 0.0), start, found.best)
    )
    assert rj.compare(truth, before).error >= BETTER * rj.compare(truth, after).error
    assert np.max(bare.violation) >= LESS * np.max(after.violation)


DRIFTING = {
    "four-bar": (four_bar, np.linspace(0.0, 3.0, 61), diffrax.Tsit5()),
    "cart-pendulum": (rj.gallery.cart_pendulum, np.linspace(0.0, 1.0, 101), rj.Rodas5P()),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", DRIFTING)
def test_mechanisms_drift_less_in_no_more_steps(name):
    make, ts, solver = DRIFTING[name]
    system = rj.assemble(make())
    found = rj.tune_baumgarte(system, ts, solver=solver, steps=30)
    bare, tuned = (
        run(system, ts, rtol=1e-6, solver=solver, stabilization=pair)
        for pair in (rj.Baumgarte(0.0, 0.0), found.best)
    )
    assert np.max(bare.violation) >= LESS * np.max(tuned.violation)
    assert tuned.stats.num_steps <= STEPS * bare.stats.num_steps


@pytest.mark.slow
def test_one_pair_for_each_constraint_and_the_cost_of_speed(pendulum):
    """The same mechanism made of two equal constraints on two masses; a price on fast parameters
    slows them down.
    """
    double = rj.CustomSystem(
        unit_mass,
        lambda t, q, v: jnp.array([0.0, -GRAVITY, 0.0, -GRAVITY]),
        lambda t, q: 0.5 * jnp.stack([q[:2] @ q[:2] - 1, q[2:] @ q[2:] - 1]),
        q0=[1.0, 0.0, 1.0, 0.0],
        v0=np.zeros(4),
    )
    ts, settings = np.linspace(0.0, 1.0, 51), {"solver": RK4(), "dt": 0.02, "steps": 20}
    both = rj.Baumgarte(jnp.array([10.0, 10.0]), jnp.array([30.0, 30.0]))
    found = rj.tune_baumgarte(double, ts, start=both, **settings)
    assert found.alpha.shape[1] == 2
    assert np.allclose(found.alpha[:, 0], found.alpha[:, 1])
    with pytest.raises(ValueError, match="more than two parameters"):
        found.landscape()
    one = rj.Baumgarte(10.0, 30.0)
    free, priced = (
        rj.tune_baumgarte(pendulum, ts, start=one, cost=cost, **settings) for cost in (0.0, 30.0)
    )
    assert priced.best.beta < free.best.beta


@pytest.mark.slow
def test_the_figure_shows_landscape_and_path(pendulum):
    ts = np.linspace(0.0, 1.0, 51)
    found = rj.tune_baumgarte(pendulum, ts, solver=RK4(), dt=0.02, steps=5)
    alphas, betas, losses = found.landscape(5)
    assert losses.shape == (len(betas), len(alphas)) == (5, 5)
    figure = rj.plot.tuning(found, count=5)
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert {"critical damping", "search", "start", "best", "default"} == set(texts)


@pytest.mark.slow
def test_what_cannot_be_tuned(pendulum):
    free = rj.CustomSystem(unit_mass, lambda t, q, v: -q, q0=[1.0], v0=[0.0])
    with pytest.raises(ValueError, match="no constraints"):
        rj.tune_baumgarte(free, np.linspace(0.0, 1.0, 11))
    with pytest.raises(ValueError, match=r"alpha=0\.0, beta=1\.0\) must be positive"):
        rj.tune_baumgarte(pendulum, np.linspace(0.0, 1.0, 11), start=rj.Baumgarte(0.0, 1.0))
    off = eqx.tree_at(lambda s: s.q0, pendulum, jnp.asarray([1.1, 0.0]))
    with pytest.raises(ValueError, match="fails, or does not drift"):
        rj.tune_baumgarte(off, np.linspace(0.0, 1.0, 11), solver=RK4(), dt=0.01)
    ts = np.linspace(0.0, 1.0, 11)
    with pytest.raises(ValueError, match="fails, or does not drift"):
        rj.tune_baumgarte(pendulum, ts, start=rj.Baumgarte(1e4, 1e8), solver=RK4(), dt=0.01)
