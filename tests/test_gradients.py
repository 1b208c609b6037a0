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
from tolerances import DIFFERENCED, IDENTITY
from zoo import bar, run, unit_mass

import romjax as rj

STEP = 1e-4  # of central differences
PLACE = np.array([1.3, 9.0])  # mass of the coupler [kg], gravity [m/s²]
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


def pinned_twice(parameters) -> rj.AbstractSystem:
    """A bar whose hinge is made twice, by a mass and a gravity."""
    mass, gravity = parameters
    scene = bar(mass, angle=0.3, spin=1.5, gravity=gravity)
    return rj.assemble(rj.Scene(scene.bodies, 2 * scene.joints, scene.effects))


def agree(function, *gradients) -> None:
    """Gradients and the central differences of a function of two numbers."""
    for i, unit in enumerate(np.eye(2)):
        wanted = (function(PLACE + STEP * unit) - function(PLACE - STEP * unit)) / (2 * STEP)
        for found in gradients:
            assert abs(found[i] - wanted) <= DIFFERENCED * max(1, abs(wanted))


@pytest.mark.slow
def test_redundant_constraints():
    """Of the acceleration, and of the multiplier of one of the two pins."""
    q, v = rj.consistent(doubled((1.0, 9.81)), v0=0.3 * np.arange(9.0))

    def point(parameters):
        a, multipliers = doubled(parameters).acceleration(0.0, q, v)
        return a @ np.cos(np.arange(9.0)) + multipliers[0] - 2 * multipliers[-1]

    gradients = jax.jit(jax.grad(point))(PLACE), jax.jit(jax.jacfwd(point))(PLACE)
    agree(jax.jit(point), *map(np.asarray, gradients))


@pytest.mark.parametrize(
    "solver", in_groups(SOLVERS, slow=SOLVERS[:1]), ids=lambda solver: type(solver).__name__
)
def test_through_solvers_and_redundant_constraints(solver):
    """A run of a bar with two hinges at one place, in reverse mode."""

    def last(parameters):
        settings = {"stabilization": rj.Baumgarte(10.0, 25.0), **FIXED}
        motion = run(pinned_twice(parameters), np.array([0.0, 0.1]), solver=solver, **settings)
        return motion.q[-1, 2] + motion.v[-1, 1] + motion.multipliers[-1, 0] / 10

    agree(jax.jit(last), np.asarray(jax.jit(jax.grad(last))(PLACE)))


def oscillation(stiffness, start, end, adjoint=None, solver=DOPRI):
    """A number that depends on all outputs of x'' = −k x, y'' = x + sin t."""
    system = rj.CustomSystem(
        unit_mass,
        lambda t, q, v: jnp.stack([-stiffness * q[0], q[0] + jnp.sin(t)]),
        q0=[1.0, 0.0],
        v0=[0.0, 0.0],
    )
    ts = jnp.stack([start, (start + end) / 2, end])
    settings = {"solver": solver, "rtol": 1e-9, "max_steps": 2000, "throw": False}
    motion = run(system, ts, adjoint=adjoint, **settings)
    return jnp.sum(motion.q * np.cos(np.arange(6.0).reshape(3, 2))) + motion.v[-1, 0]


@pytest.mark.slow
def test_more_steps_than_checkpoints_and_lanes_of_different_lengths():
    """512 checkpoints, and lanes of 6, 318 and 1139 steps; also by the times of a load that needs
    them. Against forward mode.
    """
    stiffness, ends = np.array([1.0, 400.0, 2500.0]), np.array([0.3, 7.0, 10.0])

    def slopes(derivative, adjoint):
        by = derivative(lambda *x: oscillation(*x, adjoint), argnums=(0, 1, 2))
        return jax.jit(jax.vmap(by, in_axes=(0, None, 0)))(stiffness, 0.1, ends)

    ways = slopes(jax.grad, None), slopes(jax.jacfwd, diffrax.ForwardMode())
    own, other = map(np.asarray, ways)
    assert_close(own[0], other[0], IDENTITY)
    assert_close(own[1:], other[1:], DIFFERENCED, scale=np.maximum(1, np.abs(other[1:])))


@pytest.mark.slow
def test_second_derivatives():
    """Forwards over backwards, against differences of the first derivative."""
    slope = jax.jit(jax.grad(lambda k: oscillation(k, 0.0, 1.0, solver=rj.Rodas5P())))
    curvature = jax.jit(jax.jacfwd(slope))(4.0)
    wanted = (slope(4.0 + STEP) - slope(4.0 - STEP)) / (2 * STEP)
    assert abs(curvature - wanted) <= DIFFERENCED
