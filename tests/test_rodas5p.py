"""The time integration: order of convergence, dense output, stiffness."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import RODAS5P, bar, run, system, unit_mass

import romjax as rj
from romjax.integrate.term import MotionTerm

# Required of the method: order 5 ± 0.2 on a smooth non-autonomous problem.
ORDER, SPREAD = 5, 0.2
STEPS = np.array([10, 20, 40])
# A slowly moving solution of a stiff equation, in steps a million times its fastest time: the error
# is that of the smooth solution, (0.1)⁵ times a small constant, not the stiffness times it.
STIFF = 1e-6


def observed(errors) -> np.ndarray:
    """The order between successive halvings of the step."""
    return np.log2(np.asarray(errors[:-1]) / np.asarray(errors[1:]))


def field(t, y, args):
    """y₁ = exp(sin t) and y₂ = 1/(1 + t + t²/2): linear and non-linear, both non-autonomous."""
    del args
    return jnp.stack([y[0] * jnp.cos(t), -(1 + t) * y[1] ** 2])


def exact(t):
    return np.stack([np.exp(np.sin(t)), 1 / (1 + t + t**2 / 2)], axis=-1)


@pytest.fixture(scope="module")
def solve():
    """Fixed steps from 0 to 2 s, with output at the end and between the steps."""
    times = np.linspace(0.0, 2.0, 98)

    @jax.jit
    def outputs(step):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            rj.Rodas5P(),
            0.0,
            2.0,
            step,
            jnp.asarray(exact(0.0)),
            saveat=diffrax.SaveAt(ts=jnp.asarray(times)),
            max_steps=100,
        ).ys

    return lambda steps: np.max(np.abs(np.asarray(outputs(2.0 / steps)) - exact(times)), axis=1)


def test_order(solve):
    errors = [solve(steps)[-1] for steps in STEPS]
    assert np.all(np.abs(observed(errors) - ORDER) <= SPREAD), observed(errors)


def test_order_between_the_steps(solve):
    """The dense output is of order 4 at least, over all times."""
    errors = [np.max(solve(steps)) for steps in STEPS]
    assert np.all(observed(errors) >= ORDER - 1 - SPREAD), observed(errors)


def test_order_of_the_embedded_method():
    """What the error estimate takes off the step is a method of order 4: its error in one step
    falls with the fifth power.
    """

    @jax.jit
    def embedded(step):
        start = jnp.asarray(exact(0.3))
        y, estimate, *_ = rj.Rodas5P().step(
            diffrax.ODETerm(field), 0.3, 0.3 + step, start, None, None, False
        )
        return y - estimate

    errors = [np.max(np.abs(embedded(1 / x) - exact(0.3 + 1 / x))) for x in STEPS]
    assert np.all(np.abs(observed(errors) - ORDER) <= SPREAD), observed(errors)


def driven(t, q, v):
    return jnp.stack([v[0] * jnp.cos(t) - q[0] * jnp.sin(t), -2 * q[1] * v[1]])


def test_order_on_an_equation_of_motion():
    """Through the second-order form: q₁ = exp(sin t), q₂ = 1/(1 + t), by forces that depend on
    time, position and velocity.
    """
    moved = rj.CustomSystem(unit_mass, driven, q0=[1.0, 1.0], v0=[1.0, -1.0])
    errors = []
    for steps in 4 * STEPS:
        end = run(moved, np.array([0.0, 2.0]), dt=2.0 / steps, solver=RODAS5P).q[-1]
        errors.append(np.max(np.abs(end - np.array([np.exp(np.sin(2.0)), 1 / 3]))))
    assert np.all(np.abs(observed(errors) - ORDER) <= SPREAD), observed(errors)


def test_the_second_order_form_changes_nothing():
    """A step with the n × n matrix of a MotionTerm is the step with the 2n × 2n Jacobian."""
    pendulum = system(bar)
    short = MotionTerm(pendulum, rj.Baumgarte(3.0, 2.0))
    long = diffrax.ODETerm(lambda t, y, args: short.vf(t, y, args))
    start = (pendulum.q0, jnp.asarray([0, 0.5, 1.0]))

    @jax.jit
    def steps(y):
        solver = rj.Rodas5P()
        return [solver.step(term, 0.3, 0.4, y, None, None, False)[:2] for term in (short, long)]

    found, wanted = (list(map(np.asarray, jax.tree.leaves(x))) for x in steps(start))
    size = max(np.max(np.abs(x)) for x in wanted[:2])
    for x, y in zip(found, wanted, strict=True):
        assert_close(x, y, IDENTITY, scale=size)


def test_a_stiff_equation():
    """Prothero and Robinson: y' = −10⁷ (y − cos t) − sin t, in steps of 0.1 s, stays on cos t."""
    solution = jax.jit(
        lambda: (
            diffrax.diffeqsolve(
                diffrax.ODETerm(lambda t, y, args: -1e7 * (y - jnp.cos(t)) - jnp.sin(t)),
                rj.Rodas5P(),
                0.0,
                2.0,
                0.1,
                jnp.ones(1),
                max_steps=30,
            ).ys
        )
    )()
    assert abs(float(solution[-1, 0]) - np.cos(2.0)) <= STIFF


def test_stability_at_infinity():
    """|R(z)| → 0 for z → −∞, and |R(iy)| ≤ 1 for the free oscillation of stiff modes."""

    @jax.jit
    def growth(z):
        turn = jnp.array([[z.real, -z.imag], [z.imag, z.real]])
        term = diffrax.ODETerm(lambda t, y, args: turn @ y)
        y, *_ = rj.Rodas5P().step(term, 0.0, 1.0, jnp.array([1.0, 0.0]), None, None, False)
        return jnp.linalg.norm(y)

    assert growth(jnp.asarray(-1e12 + 0j)) <= SOLVED
    for frequency in (0.1, 1.0, 10.0, 1e3):
        assert growth(jnp.asarray(1j * frequency)) <= 1 + IDENTITY


# Terms of diffrax.

STRAIGHT = diffrax.ODETerm(field)
HALVES = diffrax.MultiTerm(
    diffrax.ODETerm(lambda t, y, args: 0.25 * field(t, y, args)),
    diffrax.ODETerm(lambda t, y, args: 0.75 * field(t, y, args)),
)


def end(term, start, adjoint, times=(0.3, 1.3)):
    """The state after one second, by Rodas5P in twenty steps, in either direction of time."""
    step = (times[1] - times[0]) / 20
    return diffrax.diffeqsolve(
        term, rj.Rodas5P(), *times, step, start, adjoint=adjoint, max_steps=64
    ).ys[-1]


@jax.jit
def whole_and_halves(start, times):
    adjoint = diffrax.RecursiveCheckpointAdjoint()
    return [end(term, start, adjoint, times) for term in (HALVES, STRAIGHT)]


@pytest.mark.parametrize("times", [(0.3, 1.3), (1.3, 0.3)], ids=["forwards", "backwards"])
def test_a_sum_of_terms_is_their_sum(times):
    """In both directions of time."""
    found, wanted = whole_and_halves(exact(times[0]), times)
    assert_close(found, wanted, IDENTITY)
    assert_close(wanted, exact(times[1]), DIFFERENCED)


@pytest.mark.slow
def test_the_continuous_adjoint():
    """`BacksolveAdjoint` differentiates what it integrates backwards, with an error of order 5: a
    fixed step of 0.05 s leaves 1e-8. The start passes to y₁ as a factor, and to 1/y₂ as a summand.
    """

    @jax.jit
    @jax.grad
    def slopes(y):
        return jnp.sum(end(STRAIGHT, y, diffrax.BacksolveAdjoint()) ** 2)

    before, after = exact(0.3), exact(1.3)
    wanted = 2 * after * np.array([after[0] / before[0], (after[1] / before[1]) ** 2])
    assert_close(slopes(before), wanted, DIFFERENCED)


@pytest.mark.parametrize("summed", [False, True])
def test_a_control_that_is_not_time_is_refused(summed):
    path = diffrax.LinearInterpolation(np.array([0.0, 2.0]), np.array([0.0, 1.0]))
    term = diffrax.ControlTerm(lambda t, y, args: y, path)
    with pytest.raises(ValueError, match=r"Rodas5P: a ControlTerm is driven .*to_ode"):
        end(
            diffrax.MultiTerm(STRAIGHT, term) if summed else term,
            jnp.ones(2),
            diffrax.DirectAdjoint(),
        )
