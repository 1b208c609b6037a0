"""Projection keeps the constraints at every saved point, and mends the start."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY
from zoo import GRAVITY, point_pendulum, run, unit_circle, unit_mass

import romjax as rj
from romjax.integrate.post_step import PostStepSolver, ProjectState
from romjax.integrate.term import MotionTerm
from romjax.system import dynamics

# Velocities reach some metres per second; an identity is relative to the size of its terms.
SCALED = 10 * IDENTITY
# Required.
ROUNDED, GRADIENT = 1e-14, 1e-7
TS = np.linspace(0.0, 2.0, 21)
SETTINGS = {"rtol": 1e-8, "stabilization": rj.Projection()}


@pytest.fixture(scope="module")
def pendulum() -> rj.CustomSystem:
    return point_pendulum()


@pytest.fixture(scope="module")
def projected(pendulum) -> rj.Trajectory:
    return run(pendulum, TS, **SETTINGS)


def test_no_drift_at_the_saved_points(projected):
    """C = (q·q − 1)/2 and Ċ = q·v."""
    q, v = np.asarray(projected.q), np.asarray(projected.v)
    assert np.max(projected.violation) <= IDENTITY
    assert_close(np.sum(q * q, axis=1), 1.0, IDENTITY)
    assert_close(np.sum(q * v, axis=1), 0.0, SCALED)


def test_a_start_off_the_constraints_is_projected(pendulum, projected):
    """The given start is nearest to the consistent one along the bar: both runs are the same."""
    mended = run(pendulum, TS, q0=np.array([1.01, 0.0]), **SETTINGS)
    assert mended.success
    assert_close(mended.q, projected.q, SCALED)


def test_forward_mode_takes_the_same_steps(pendulum, projected):
    """Its adjoint prepares Runge–Kutta methods, wrapped ones too."""
    other = run(pendulum, TS, adjoint=diffrax.ForwardMode(), **SETTINGS)
    assert_close(other.q, projected.q, SCALED)


def test_a_motion_at_rest_has_an_absolute_error(projected):
    """No motion to relate an error to: a number, not NaN."""
    rest = eqx.tree_at(lambda m: m.q, projected, np.zeros(projected.q.shape))
    assert rj.compare(rest, rest).error == 0
    assert np.isfinite(rj.compare(rest, projected).error)


def test_a_motion_that_failed_has_no_error(projected):
    """NaN from where it failed on: not the error of a motion that is right."""
    q = np.where(np.arange(len(projected.t))[:, None] < len(projected.t) // 2, projected.q, np.nan)
    failed = eqx.tree_at(lambda m: m.q, projected, q)
    assert np.isnan(rj.compare(projected, failed).error)
    assert np.isnan(rj.compare(failed, projected).error)


def test_every_step_is_on_the_constraints(pendulum):
    """Not the saved points alone: C and Ċ after each accepted step, at rounding."""
    solver = PostStepSolver(diffrax.Tsit5(), ProjectState(2))

    @jax.jit
    def steps():
        solution = diffrax.diffeqsolve(
            MotionTerm(pendulum, None),
            solver,
            0.0,
            2.0,
            1e-3,
            (pendulum.q0, pendulum.v0),
            saveat=diffrax.SaveAt(steps=True),
            stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6),
            max_steps=256,
        )
        states = jax.vmap(lambda *x: dynamics.constraint_state(pendulum, *x))
        state = states(solution.ts, *solution.ys)
        return solution.ts, state.violation, state.rate

    t, violation, rate = map(np.asarray, steps())
    made = np.isfinite(t)
    assert np.sum(made) > 10
    assert np.max(np.abs(violation[made])) <= ROUNDED
    assert np.max(np.abs(rate[made])) <= SCALED


def test_projection_costs_few_steps(pendulum):
    """At most a tenth more than without any stabilisation."""

    def count(keep):
        return run(pendulum, TS, rtol=1e-6, stabilization=keep).stats.num_steps

    assert count(rj.Projection()) <= 1.1 * count(None)


class Weight(eqx.Module):
    """Gravity, which is a parameter."""

    gravity: jax.Array

    def __call__(self, t, q, v):
        return jnp.stack([jnp.zeros(()), -self.gravity])


@pytest.mark.slow
def test_the_gradient_passes_through():
    """With respect to the start and to gravity, against central differences."""

    def last(parameters):
        angle, gravity = parameters
        start = 1.05 * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        swing = rj.CustomSystem(unit_mass, Weight(gravity), unit_circle, q0=start, v0=jnp.zeros(2))
        settings = {"stabilization": rj.Projection(), "throw": False}
        motion = run(swing, TS[:4], dt=0.02, solver=diffrax.Tsit5(), **settings)
        return motion.q[-1, 0] + motion.v[-1, 1] + motion.multipliers[-1, 0] / 10

    place, step = np.array([0.3, GRAVITY]), 1e-4
    found, value = np.asarray(jax.jit(jax.grad(last))(place)), jax.jit(last)
    for i, unit in enumerate(np.eye(2)):
        wanted = (value(place + step * unit) - value(place - step * unit)) / (2 * step)
        assert abs(found[i] - wanted) <= GRADIENT * max(1, abs(wanted))
