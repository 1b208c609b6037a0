"""Derivatives through every solver, and through redundant constraints, three ways."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from comparison import assert_close
from groups import in_groups
from mechanisms import linkage
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj

STEP = 1e-4  # of central differences
PLACE = jnp.array([1.3, 9.0])  # mass of the coupler [kg], gravity [m/s²]
POINTS = {"A": (0, 0), "b": (0.3, 0.9), "c": (1.8, 1.3), "D": (2.0, 0)}
DOPRI = diffrax.Dopri8()
FIXED = {"dt": 0.02, "throw": False}
NEWTON = optimistix.Chord(rtol=1e-10, atol=1e-10, norm=optimistix.max_norm)
# Explicit methods are in all other tests of gradients.
SOLVERS = [rj.Rodas5P(), diffrax.Kvaerno5(root_finder=NEWTON)]


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


@pytest.mark.slow
def test_redundant_constraints():
    """Of the acceleration, and of the multiplier of one of the two pins."""
    q, v = rj.consistent(doubled((1.0, 9.81)), v0=0.3 * jnp.arange(9.0))

    def point(parameters):
        a, multipliers = doubled(parameters).acceleration(0.0, q, v)
        return a @ jnp.cos(jnp.arange(9.0)) + multipliers[0] - 2 * multipliers[-1]

    gradients = jax.jit(jax.grad(point))(PLACE), jax.jit(jax.jacfwd(point))(PLACE)
    agree(jax.jit(point), *gradients)


@pytest.mark.parametrize(
    "solver", in_groups(SOLVERS, slow=SOLVERS[:1]), ids=lambda solver: type(solver).__name__
)
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


def oscillation(stiffness, start, end, adjoint=None, solver=DOPRI):
    """A number that depends on all outputs of x'' = −k x, y'' = x + sin t."""
    system = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: jnp.stack([-stiffness * q[0], q[0] + jnp.sin(t)]),
        q0=[1.0, 0.0],
        v0=[0.0, 0.0],
    )
    ts = jnp.stack([start, (start + end) / 2, end])
    settings = {"solver": solver, "rtol": 1e-9, "max_steps": 2000, "throw": False}
    run = rj.simulate(system, ts, adjoint=adjoint, **settings)
    return jnp.sum(run.q * jnp.cos(jnp.arange(6.0).reshape(3, 2))) + run.v[-1, 0]


@pytest.mark.slow
def test_more_steps_than_checkpoints_and_lanes_of_different_lengths():
    """512 checkpoints, and lanes of 6, 318 and 1139 steps; also by the times of a load that needs
    them. Against the checkpoints of diffrax, for which the first step follows the times.
    """
    stiffness, ends = jnp.array([1.0, 400.0, 2500.0]), jnp.array([0.3, 7.0, 10.0])

    def slopes(adjoint):
        by = jax.grad(lambda *x: oscillation(*x, adjoint), argnums=(0, 1, 2))
        return jax.jit(jax.vmap(by, in_axes=(0, None, 0)))(stiffness, 0.1, ends)

    own, other = slopes(None), slopes(diffrax.RecursiveCheckpointAdjoint())
    assert_close(own[0], other[0], IDENTITY)
    assert_close(own[1:], other[1:], DIFFERENCED, scale=np.maximum(1, np.abs(other[1:])))


@pytest.mark.slow
def test_lanes_that_fail_spoil_no_others():
    """The second lane needs more steps than it may take."""
    by = jax.vmap(jax.grad(lambda k: oscillation(k, 0.0, 10.0)))
    alone = jax.jit(by)(jnp.array([1.0]))
    assert_close(jax.jit(by)(jnp.array([1.0, 1e5]))[:1], alone, SOLVED)


@pytest.mark.slow
def test_second_derivatives():
    """Forwards over backwards, against differences of the first derivative."""
    slope = jax.jit(jax.grad(lambda k: oscillation(k, 0.0, 1.0, solver=rj.Rodas5P())))
    curvature = jax.jit(jax.jacfwd(slope))(4.0)
    wanted = (slope(4.0 + STEP) - slope(4.0 - STEP)) / (2 * STEP)
    assert abs(curvature - wanted) <= DIFFERENCED
