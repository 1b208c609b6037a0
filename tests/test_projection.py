"""Projection keeps the constraints at every saved point, and mends the start."""

import equinox as eqx
import jax.numpy as jnp
import pytest
from tolerances import IDENTITY

import romjax as rj

# Velocities reach some metres per second; an identity is relative to the size of its terms.
SCALED = 10 * IDENTITY
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
        assert jnp.max(jnp.abs(pendulum.constraint_state(t, q, v).rate)) <= SCALED


def test_a_start_off_the_constraints_is_projected(pendulum, projected):
    """The given start is nearest to the consistent one along the bar: both runs are the same."""
    off = pendulum.q0 + jnp.array([0.01, 0.0, 0.0])
    mended = rj.simulate(pendulum, TS, q0=off, rtol=1e-8, stabilization=rj.Projection())
    assert mended.success
    assert jnp.max(jnp.abs(mended.q - projected.q)) <= SCALED


def test_a_motion_at_rest_has_an_absolute_error(projected):
    """No motion to relate an error to: a number, not NaN."""
    rest = eqx.tree_at(lambda m: m.q, projected, jnp.zeros_like(projected.q))
    assert rj.compare(rest, rest).error == 0
    assert jnp.isfinite(rj.compare(rest, projected).error)
