"""Parameters from noisy measurements."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
import zoo

import romjax as rj
from romjax.integrate.doubt import warn_of_outcome
from romjax.integrate.status import Status
from romjax.system.flags import Flag

TS = np.linspace(0.0, 1.0, 101)
TRUE = {"damping": 0.1, "f1": 16.0, "stiffness": 100.0}
START = {"damping": 0.2, "f1": 15.0, "stiffness": 80.0}
NOISE = 0.01  # of the standard deviation of each sensor
SEEDS = 20
ERRORS = 3  # required: standard errors that each parameter may be off


def sensors(p):
    """The cart's place, the pendulum's angle and its first bending mode."""
    scene = rj.gallery.cart_pendulum(**p)
    run = rj.simulate(rj.assemble(scene), TS, solver=rj.Rodas5P(), throw=False, audit=False)
    return run.q[:, np.array([0, 5, 6])]


def line(p):
    return p["a"] + p["b"] * TS


def tiny(p):
    """A spring that swings by a nanometre, which the tolerances that are given do not resolve."""
    force = zoo.Stiffness(p["k"], jnp.array(0.0))
    system = rj.CustomSystem(zoo.unit_mass, force, q0=[1e-9], v0=[0.0])
    return 1e9 * rj.simulate(system, TS, atol=1e-6, throw=False, audit=False).q[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("predict", [tiny, jax.jit(tiny)])
def test_doubtful_runs_at_the_best_parameters_are_told(predict):
    """Whether or not the user has compiled what is fitted."""
    words = "fit, at the best parameters: a run is doubtful: its tolerances are hardly smaller"
    with pytest.warns(UserWarning, match=words):
        rj.fit(predict, {"k": 3.0}, np.cos(2 * TS), steps=2)


@pytest.mark.instant
def test_what_is_told_of_a_run():
    """By its status, or by those flags that a run of its own would warn of."""
    told = {(Status.MAX_STEPS, 0): "a run failed: the solver used up max_steps"}
    told[Status.SUCCESS, Flag.ENERGY] = "a run is doubtful: its energy changes by more than"
    for (status, flags), words in told.items():
        with pytest.warns(UserWarning, match=f"it: {words}"):
            warn_of_outcome("it", status, flags)
    warn_of_outcome("it", Status.SUCCESS, Flag.OUTSIDE_TRAINING)


@pytest.mark.exhaustive
def test_a_cart_pendulum_from_noise():
    """Stiffness, damping and first frequency, within three standard errors for every seed."""
    clean = np.asarray(sensors(TRUE))
    noise = NOISE * np.std(clean, axis=0)
    for seed in range(SEEDS):
        measured = clean + noise * np.random.default_rng(seed).normal(size=clean.shape)
        found = rj.fit(sensors, START, measured, noise=noise, lower=0.0)
        assert found.success
        for name, value in TRUE.items():
            off = abs(found.parameters[name] - value) / found.standard_errors[name]
            assert off <= ERRORS, (seed, name)


@pytest.mark.parametrize("optimizer", [None, optax.adam(0.3)])
def test_a_line_is_linear_regression(optimizer):
    """Values and covariance against the closed form, with a gap in the data."""
    rng = np.random.default_rng(0)
    measured = np.asarray(line({"a": 1.0, "b": -2.0})) + 0.1 * rng.normal(size=len(TS))
    measured[40:50] = np.nan
    found = rj.fit(line, {"a": 0.5, "b": -1.0}, measured, optimizer=optimizer, steps=3000)
    there = np.isfinite(measured)
    columns = np.stack([np.ones(len(TS)), TS], axis=1)[there]
    wanted, rest, *_ = np.linalg.lstsq(columns, measured[there], rcond=None)
    covariance = rest[0] / (there.sum() - 2) * np.linalg.inv(columns.T @ columns)
    assert found.success
    assert np.allclose([found.parameters["a"], found.parameters["b"]], wanted, rtol=1e-4)
    assert np.allclose(found.covariance, covariance, rtol=1e-4)


def test_bounds_are_never_touched():
    """A bound on either side, on both, and on none; the best slope lies outside of its bounds."""
    seen = []

    def watched(p):
        seen.append(p)
        return line(p)

    measured = np.asarray(line({"a": 1.0, "b": -2.0}))
    upper = {"a": np.inf, "b": -0.5}
    found = rj.fit(watched, {"a": 0.5, "b": -1.0}, measured, lower=-1.5, upper=upper)
    assert -1.5 < found.parameters["b"] < -0.5
    assert found.parameters["b"] < -1.49
    only = {"a": np.inf, "b": 0.0}
    found = rj.fit(line, {"a": 0.5, "b": -1.0}, measured, upper=only)
    assert np.allclose([found.parameters["a"], found.parameters["b"]], [1, -2], atol=1e-6)


def test_small_numbers_are_fitted_like_large_ones():
    """Micrometres: what ends the search is relative, and so is what begins it."""
    measured = 1e-6 * np.asarray(line({"a": 1.0, "b": -2.0}))
    found = rj.fit(lambda p: 1e-6 * line(p), {"a": 0.5, "b": -1.0}, measured)
    assert np.allclose([found.parameters["a"], found.parameters["b"]], [1, -2], atol=1e-6)


def test_what_is_not_determined_has_no_finite_error():
    """Two factors of one slope, a number without effect, and an intercept that is determined."""
    start = {"a": 0.5, "b": -1.0, "c": 1.0, "d": 0.0}
    measured = np.asarray(line({"a": 1.0, "b": -2.0}))
    found = rj.fit(lambda p: p["d"] + p["a"] * p["b"] * TS + 0 * p["c"], start, measured)
    infinite = {name: bool(np.isinf(error)) for name, error in found.standard_errors.items()}
    assert infinite == {"a": True, "b": True, "c": True, "d": False}


def test_a_bound_for_some_parameters():
    measured = np.asarray(line({"a": 1.0, "b": -2.0}))
    found = rj.fit(line, {"a": 0.5, "b": -1.0}, measured, lower={"a": 0.0, "b": None})
    assert np.allclose([found.parameters["a"], found.parameters["b"]], [1, -2], atol=1e-6)


def test_what_cannot_be_fitted():
    start, measured = {"a": 0.5, "b": -1.0}, np.zeros(len(TS))
    with pytest.raises(ValueError, match=r"start -1 of parameter 2 lies outside of its bounds 0"):
        rj.fit(line, start, measured, lower=0.0)
    with pytest.raises(ValueError, match=r"shape \(101,\), but measured has \(5,\)"):
        rj.fit(line, start, measured[:5])
    with pytest.raises(ValueError, match="not finite at the start"):
        rj.fit(lambda p: jnp.log(p["b"]) * TS, start, measured)
    with pytest.raises(ValueError, match="nothing was measured"):
        rj.fit(line, start, np.nan * measured)
    with pytest.raises(ValueError, match="noise must be positive"):
        rj.fit(line, start, measured, noise=0.0)
    with pytest.raises(ValueError, match="upper must be a number or a pytree like the start"):
        rj.fit(line, start, measured, upper={"a": 1.0, "b": 1.0, "c": 1.0})
