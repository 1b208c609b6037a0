"""Derivatives through every solver, and through redundant constraints, three ways."""

import diffrax
import jax
import jax.numpy as jnp
import optimistix
import pytest
from mechanisms import linkage
from tolerances import DIFFERENCED

import romjax as rj

STEP = 1e-4  # of central differences
PLACE = jnp.array([1.3, 9.0])  # mass of the coupler [kg], gravity [m/s²]
POINTS = {"A": (0, 0), "b": (0.3, 0.9), "c": (1.8, 1.3), "D": (2.0, 0)}
FIXED = {"dt": 0.02, "throw": False}
NEWTON = optimistix.Chord(rtol=1e-10, atol=1e-10, norm=optimistix.max_norm)
SOLVERS = [
    diffrax.Tsit5(),
    pytest.param(diffrax.Dopri8(), marks=pytest.mark.slow),
    pytest.param(rj.Rodas5P(), marks=pytest.mark.slow),
    pytest.param(diffrax.Kvaerno5(root_finder=NEWTON), marks=pytest.mark.slow),
]


def doubled(parameters) -> rj.AbstractSystem:
    """A four-bar under gravity with its first hinge made twice, by a mass and a gravity."""
    mass, gravity = parameters
    bars = [("A", "b"), ("b", "c"), ("D", "c")]
    scene = linkage(POINTS, bars, {}, masses=[1.0, mass, 1.0])
    return rj.assemble(
        rj.Scene(scene.bodies, (*scene.joints, scene.joints[0]), [rj.Gravity((0.0, -gravity))])
    )


def agree(function, reverse, forward) -> None:
    """Two gradients and the central differences of a function of two numbers."""
    for i, unit in enumerate(jnp.eye(2)):
        wanted = (function(PLACE + STEP * unit) - function(PLACE - STEP * unit)) / (2 * STEP)
        for found in (reverse, forward):
            assert abs(found[i] - wanted) <= DIFFERENCED * max(1, abs(wanted))


def test_redundant_constraints():
    """Of the acceleration, and of the multiplier of one of the two pins."""
    q, v = rj.consistent(doubled((1.0, 9.81)), v0=0.3 * jnp.arange(9.0))

    def point(parameters):
        a, multipliers = doubled(parameters).acceleration(0.0, q, v)
        return a @ jnp.cos(jnp.arange(9.0)) + multipliers[0] - 2 * multipliers[-1]

    gradients = jax.jit(jax.grad(point))(PLACE), jax.jit(jax.jacfwd(point))(PLACE)
    agree(jax.jit(point), *gradients)


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_through_solvers_and_redundant_constraints(solver):
    """A run of the redundant four-bar in fixed steps, by reverse and forward adjoint."""

    def last(parameters, adjoint=None):
        motion = rj.simulate(
            doubled(parameters),
            jnp.array([0.0, 0.1]),
            solver=solver,
            stabilization=rj.Baumgarte(10.0, 25.0),
            adjoint=adjoint,
            **FIXED,
        )
        return motion.q[-1, 2] + motion.v[-1, 4] + motion.multipliers[-1, 0] / 10

    reverse = jax.jit(jax.grad(last))(PLACE)
    forward = jax.jit(jax.jacfwd(lambda p: last(p, diffrax.ForwardMode())))(PLACE)
    agree(jax.jit(last), reverse, forward)
