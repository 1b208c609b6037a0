"""A spring whose rest length is zero is linear, where its points meet too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax import spatial

MASS, STIFFNESS = 2.0, 200.0


def held(dimension, rest, cubic=None) -> rj.AbstractSystem:
    """A mass at the origin on a spring to it."""
    if dimension == 2:
        body = rj.RigidBody("mass", MASS, 0.1)
    else:
        body = spatial.RigidBody("mass", MASS, (0.1, 0.2, 0.3))
    spring = rj.Spring(body.at(), rj.ground.at((0.0,) * dimension), STIFFNESS, rest, cubic)
    return rj.assemble(rj.Scene([body], [], [spring]))


@pytest.mark.parametrize("dimension", [2, 3])
def test_force_and_stiffness(dimension):
    """−k r and k everywhere, for a rest length that is traced too; and no force on a spring with a
    rest length whose points meet, in no direction.
    """

    @jax.jit
    def at(rest, place):
        def force(rest, place):
            system = held(dimension, rest)
            q = system.q0.at[:dimension].set(place)
            return system.force(0.0, q, jnp.zeros(system.n))[:dimension]

        return force(rest, place), *jax.jacfwd(force, argnums=(0, 1))(rest, place)

    zero, unit = np.zeros(dimension), np.eye(dimension)
    for place in (zero, 1e-170 * unit[0], 1e-9 * unit[0], 0.3 * unit[1]):
        force, by_rest, slope = at(0.0, place)
        assert_close(force, -STIFFNESS * place, IDENTITY, scale=STIFFNESS * np.max(place) + 1e-300)
        assert_close(slope, -STIFFNESS * unit, IDENTITY)
        assert np.all(np.isfinite(by_rest))
    force, by_rest, slope = at(0.4, zero)
    assert_close(force, zero, 0.0)
    assert_close(by_rest, zero, 0.0)
    assert np.all(np.isfinite(slope))


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_modes(dimension):
    """√(k/m), as for a spring to which no rest length is given."""
    found = rj.modes(held(dimension, 0.0)).frequencies[-dimension:]
    assert_close(found, np.full(dimension, np.sqrt(STIFFNESS / MASS)), IDENTITY)
