"""Gradients three ways: of published problems, and of functions that are wrong."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import DIFFERENCED
from verification_problems import simeon
from verification_problems.slopes import SPRUNG, slider_crank
from zoo import run, unit_mass

import romjax as rj
from romjax.study.fits.gradient import _differences

# Required of published gradients.
SUNDIALS, SIMEON = 1e-6, 1e-5


@pytest.mark.slow
def test_the_published_gradient_of_a_slider_crank():
    """G = ∫ T dt over 10 s, by Gauss's rule on the outputs; its derivatives by k and c."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ts, weights = np.append(0.0, 5 * (nodes + 1)), 5 * weights

    def energy(x):
        motion = run(slider_crank(x[0], x[1]), ts)
        kinetic = 0.5 * jnp.sum(np.array([[1.0, 1.0, 2.0]]) * motion.v[1:] ** 2, axis=1)
        return weights @ kinetic

    found = rj.check_gradient(energy, np.array([1.0, 1.0]))
    for gradient in (found.reverse, found.forward):
        assert abs(gradient[0] - SPRUNG[0]) <= SUNDIALS
        assert abs(gradient[1] - SPRUNG[1]) <= SUNDIALS
    assert found.error <= DIFFERENCED


@pytest.mark.exhaustive
def test_the_gradient_of_simeons_slider_crank():
    """By the logarithms of Young's modulus and of the slider's mass: 400 fast periods. The start
    is projected with each mass matrix; 24-digit computation.
    """

    def end(x):
        system = simeon.slider_crank(0.20e12 * jnp.exp(x[0]), 0.075552 * jnp.exp(x[1]))
        motion = simeon.run(system)
        return jnp.concatenate([motion.q[-1], motion.v[-1]])

    with rj.forward_mode():
        forward = jax.jit(jax.jacfwd(end))(jnp.zeros(2))
    weight = jnp.cos(jnp.arange(14.0))
    reverse = jax.jit(jax.grad(lambda x: weight @ end(x)))(jnp.zeros(2))
    for i, wanted in enumerate((simeon.BY_MODULUS, simeon.BY_SLIDER)):
        size = np.max(np.abs(wanted))
        assert np.max(np.abs(forward[:, i] - np.array(wanted))) <= SIMEON * size
        assert abs(reverse[i] - weight @ jnp.array(wanted)) <= SIMEON * size


@pytest.mark.slow
def test_it_says_where_a_gradient_is_wrong():
    """A rule that doubles the derivative by one of the parameters."""

    @jax.custom_jvp
    def wrong(x):
        return x

    wrong.defjvp(lambda x, dx: (x[0], 2 * dx[0]))
    found = rj.check_gradient(lambda x: wrong(x["a"]) ** 2 + x["b"] ** 3, {"a": 1.0, "b": 2.0})
    assert found.part == "['a']"
    assert abs(found.error - 0.5) <= DIFFERENCED
    assert "['b']" in str(found)


@pytest.mark.slow
def test_a_compiled_function_follows_the_mode():
    """Also one that was compiled before, in the other mode."""

    @jax.jit
    def swing(stiffness):
        system = rj.CustomSystem(
            unit_mass, lambda t, q, v: -stiffness * jnp.sin(q), q0=[1.0], v0=[0.0]
        )
        return run(system, np.linspace(0.0, 1.0, 3), solver=diffrax.Tsit5()).q[-1, 0]

    jax.grad(swing)(2.0)
    assert rj.check_gradient(swing, 2.0).error <= DIFFERENCED


@pytest.mark.slow
def test_units_of_parameters_do_not_matter():
    """A wrong rule for a modulus of 2e11 is seen."""

    @jax.custom_jvp
    def wrong(x):
        return jnp.log(x / 1e11) + 1

    wrong.defjvp(lambda x, dx: (wrong(x[0]), 2 * dx[0] / x[0]))
    assert abs(rj.check_gradient(wrong, 2e11).error - 0.5) <= DIFFERENCED


@pytest.mark.slow
def test_what_is_right():
    """And zeros up to rounding are no trouble."""
    place = np.array([np.cos(np.pi / 2), 1.0])
    found = rj.check_gradient(jax.jit(lambda x: jnp.sum(jnp.sin(x)) + 1), place)
    assert found.error <= DIFFERENCED
    assert "[1]" in str(found)


@pytest.mark.instant
def test_differences_suit_the_function():
    """One that bends within a few steps, one of which rounding hides the slope at the first, and
    one that ends nearby.
    """
    functions = {
        "bends": (lambda x: np.sin(100 * x), 0.0, 100.0),
        "rounded": (lambda x: 9.0 + 3e-7 * x, 0.0, 3e-7),
        "ends": (lambda x: x**2 if x > 0 else np.nan, 0.005, 0.01),
    }
    for f, x, slope in functions.values():
        found = _differences(lambda x, f=f: f(x[0]), np.array([x]), np.array([1e-3]))
        assert abs(found[0] - slope) <= 1e-5 * slope


def test_what_has_no_gradient():
    with pytest.raises(ValueError, match="must return a number"):
        rj.check_gradient(lambda x: x, np.ones(2))
    with pytest.raises(ValueError, match="where it is finite"):
        rj.check_gradient(jnp.log, np.asarray(-1.0))
