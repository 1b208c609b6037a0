"""Projection keeps the constraints at every saved point, and mends the start."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from tolerances import IDENTITY

import romjax as rj
from romjax.integrate.post_step import PostStepSolver, ProjectState
from romjax.integrate.term import MotionTerm
from romjax.system import dynamics

# Velocities reach some metres per second; an identity is relative to the size of its terms.
SCALED = 10 * IDENTITY
# Required.
ROUNDED, GRADIENT = 1e-14, 1e-7
TS = jnp.linspace(0.0, 2.0, 21)


@pytest.fixture(scope="module")
def pendulum() -> rj.AbstractSystem:
    return rj.assemble(rj.gallery.chain(1))


@pytest.fixture(scope="module")
def projected(pendulum) -> rj.Trajectory:
    return rj.simulate(pendulum, TS, rtol=1e-8, stabilization=rj.Projection())


def test_no_drift_at_the_saved_points(pendulum, projected):
    assert jnp.max(projected.violation) <= IDENTITY
    for t, q, v in zip(projected.t, projected.q, projected.v, strict=True):
        assert jnp.max(jnp.abs(dynamics.constraint_state(pendulum, t, q, v).rate)) <= SCALED


def test_a_start_off_the_constraints_is_projected(pendulum, projected):
    """The given start is nearest to the consistent one along the bar: both runs are the same."""
    off = pendulum.q0 + jnp.array([0.01, 0.0, 0.0])
    mended = rj.simulate(pendulum, TS, q0=off, rtol=1e-8, stabilization=rj.Projection())
    assert mended.success
    assert jnp.max(jnp.abs(mended.q - projected.q)) <= SCALED


def test_forward_mode_takes_the_same_steps(pendulum, projected):
    """Its adjoint prepares Runge–Kutta methods, wrapped ones too."""
    settings = {"rtol": 1e-8, "stabilization": rj.Projection(), "adjoint": diffrax.ForwardMode()}
    other = rj.simulate(pendulum, TS, **settings)
    assert jnp.max(jnp.abs(other.q - projected.q)) <= SCALED


def test_a_motion_at_rest_has_an_absolute_error(projected):
    """No motion to relate an error to: a number, not NaN."""
    rest = eqx.tree_at(lambda m: m.q, projected, jnp.zeros_like(projected.q))
    assert rj.compare(rest, rest).error == 0
    assert jnp.isfinite(rj.compare(rest, projected).error)


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
        return solution.ts, *solution.ys

    t, q, v = (x[jnp.isfinite(x[:, 0]) if x.ndim > 1 else jnp.isfinite(x)] for x in steps())
    state = jax.vmap(lambda *x: dynamics.constraint_state(pendulum, *x))(t, q, v)
    assert len(t) > 10
    assert jnp.max(jnp.abs(state.violation)) <= ROUNDED
    assert jnp.max(jnp.abs(state.rate)) <= SCALED


def test_projection_costs_few_steps(pendulum):
    """At most a tenth more than without any stabilisation."""

    def count(keep):
        found = rj.simulate(pendulum, TS, rtol=1e-6, solver=diffrax.Tsit5(), stabilization=keep)
        return found.stats.num_steps

    assert count(rj.Projection()) <= 1.1 * count(None)


@pytest.mark.slow
def test_the_gradient_passes_through(pendulum):
    """With respect to the start and to gravity, against central differences."""
    scene = rj.gallery.chain(1)

    def last(parameters):
        angle, gravity = parameters
        changed = rj.Scene(scene.bodies, scene.joints, [rj.Gravity((0.0, -gravity))])
        start = jnp.stack([0.5 * jnp.cos(angle), 0.5 * jnp.sin(angle), angle])
        motion = rj.simulate(
            rj.assemble(changed),
            TS[:4],
            q0=start,
            dt=0.02,
            solver=diffrax.Tsit5(),
            stabilization=rj.Projection(),
            throw=False,
        )
        return motion.q[-1, 0] + motion.v[-1, 1] + motion.multipliers[-1, 0] / 10

    place, step = jnp.array([0.3, 9.0]), 1e-4
    found, value = jax.jit(jax.grad(last))(place), jax.jit(last)
    for i, unit in enumerate(jnp.eye(2)):
        wanted = (value(place + step * unit) - value(place - step * unit)) / (2 * step)
        assert abs(found[i] - wanted) <= GRADIENT * max(1, abs(wanted))
