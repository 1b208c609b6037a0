"""Bayesian identification: the likelihood, and a posterior by NUTS against one on a grid."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY
from zoo import GRAVITY

import romjax as rj

TS = np.linspace(0.0, 2.0, 21)
LENGTH, DAMPING, NOISE = 0.8, 0.3, 0.02
# Priors: standard deviations of the length [m] and of the damping [1/s] about these.
PRIOR, WIDTH = np.array([0.9, 0.4]), np.array([0.2, 0.2])
# Required: of posterior means and standard deviations, in the latter; 600 samples have 0.05.
SAMPLED = 0.25


def predict(parameters):
    """The angle of a damped pendulum over time."""
    length, damping = parameters
    swing = rj.CustomSystem(
        lambda q: jnp.ones((1, 1)),
        lambda t, q, v: -GRAVITY / length * jnp.sin(q) - damping * v,
        q0=[1.0],
        v0=[0.0],
    )
    settings = {"solver": diffrax.Tsit5(), "throw": False, "audit": False}
    return rj.simulate(swing, TS, **settings).q[:, 0]


@pytest.fixture(scope="module")
def measured():
    truth = predict((LENGTH, DAMPING))
    return np.asarray(truth) + NOISE * np.random.default_rng(3).normal(size=len(TS))


def test_the_density_of_normal_noise():
    data, guess = np.array([1.0, np.nan, 2.5]), np.array([1.1, 5.0, 2.0])
    found = jax.jit(lambda x: rj.log_likelihood(lambda x: x, x, data, 0.3))(guess)
    off = (guess - data)[[0, 2]] / 0.3
    wanted = np.sum(-(off**2) / 2 - np.log(0.3 * np.sqrt(2 * np.pi)))
    assert_close(found, wanted, IDENTITY, scale=abs(wanted))


@pytest.mark.slow
def test_doubtful_runs_are_told():
    """When the program runs; of a nanometre, which the given tolerances do not resolve."""

    def tiny(k):
        force = zoo.Stiffness(k, jnp.array(0.0))
        system = rj.CustomSystem(zoo.unit_mass, force, q0=[1e-9], v0=[0.0])
        return 1e9 * rj.simulate(system, TS, atol=1e-6, throw=False, audit=False).q[:, 0]

    likelihood = jax.jit(jax.value_and_grad(lambda k: rj.log_likelihood(tiny, k, np.cos(TS), 0.1)))

    def evaluate():
        jax.block_until_ready(likelihood(1.0))
        jax.effects_barrier()

    with pytest.warns(UserWarning, match="log_likelihood: a run is doubtful: its tolerances are"):
        evaluate()


def test_a_run_that_fails_has_none():
    likelihood = jax.value_and_grad(lambda x: rj.log_likelihood(lambda x: x, x, np.ones(2), 0.1))
    found, slope = jax.jit(likelihood)(np.array([1.0, np.nan]))
    assert found == -np.inf
    assert np.all(np.isfinite(slope))


def test_finite_numbers_of_a_run_that_fails_have_none():
    """Of a start that violates a joint, of which the motion goes on; and measured, too."""
    system = zoo.system(zoo.bar)

    def seen(apart):
        run = zoo.run(system, TS, q0=np.add(system.q0, [apart, 0.0, 0.0]), throw=False)
        assert np.all(np.isfinite(run.multipliers)) != bool(apart)
        return run.q[:, 2]

    truth = np.asarray(seen(0.0))
    assert np.isfinite(rj.log_likelihood(seen, 0.0, truth, 0.1))
    with pytest.warns(UserWarning, match="log_likelihood: a run failed: the start"):
        assert rj.log_likelihood(lambda _: seen(0.1), 0.1, truth, 0.1) == -np.inf


def test_what_is_refused():
    with pytest.raises(rj.InputError, match=r"shape \(2,\), but measured has \(3,\)"):
        rj.log_likelihood(lambda x: x, np.zeros(2), np.zeros(3), 0.1)
    with pytest.raises(rj.InputError, match="must be positive"):
        rj.log_likelihood(lambda x: x, np.zeros(2), np.zeros(2), 0.0)
    with pytest.raises(rj.InputError, match="nothing was measured"):
        rj.log_likelihood(lambda x: x, np.zeros(2), np.full(2, np.nan), 0.1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("forward", [True, False], ids=["forward", "reverse"])
def test_a_posterior(measured, forward):
    """Means, deviations and the correlation of NUTS are those of a grid."""
    numpyro = pytest.importorskip("numpyro")
    normal = numpyro.distributions.Normal

    def model():
        length = numpyro.sample("length", normal(PRIOR[0], WIDTH[0]))
        damping = numpyro.sample("damping", normal(PRIOR[1], WIDTH[1]))
        numpyro.factor("run", rj.log_likelihood(predict, (length, damping), measured, NOISE))

    kernel = numpyro.infer.NUTS(model, forward_mode_differentiation=forward)
    sampler = numpyro.infer.MCMC(kernel, num_warmup=200, num_samples=600, progress_bar=False)
    if forward:
        with rj.forward_mode():
            sampler.run(jax.random.key(0))
    else:
        sampler.run(jax.random.key(0))
    samples = np.stack([sampler.get_samples()[name] for name in ("length", "damping")], axis=1)

    center, reach = np.mean(samples, axis=0), 6 * np.std(samples, axis=0)
    axes = [np.linspace(m - r, m + r, 61) for m, r in zip(center, reach, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    heights = jax.jit(
        lambda x: jax.lax.map(lambda p: rj.log_likelihood(predict, p, measured, NOISE), x)
    )(jnp.asarray(points))
    heights = np.asarray(heights) - 0.5 * np.sum(((points - PRIOR) / WIDTH) ** 2, axis=1)
    weights = np.exp(heights - np.max(heights))
    weights /= np.sum(weights)
    mean = weights @ points
    covariance = (points - mean).T @ ((points - mean) * weights[:, None])
    deviation = np.sqrt(np.diag(covariance))
    assert_close(center, mean, SAMPLED, scale=deviation)
    assert_close(np.std(samples, axis=0), deviation, SAMPLED, scale=deviation)
    correlation = covariance[0, 1] / np.prod(deviation)
    assert_close(np.corrcoef(samples.T)[0, 1], correlation, SAMPLED)
    assert np.all(np.abs(mean - [LENGTH, DAMPING]) < 4 * deviation)
