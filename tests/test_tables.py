"""Tables: one or two freedoms in as many coordinates, against redundant ones."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from mechanisms import linkage
from tolerances import DIFFERENCED, IDENTITY, PUBLISHED, SOLVED
from zoo import five_bar, slider_crank

import romjax as rj

TS = np.linspace(0.0, 1.0, 101)


def of_one(system) -> rj.Basis:
    """A basis that says nothing but where the system starts."""
    return rj.Basis.from_modes(np.eye(system.n)[:, :1], system.q0)


@pytest.fixture(scope="module")
def full() -> rj.AbstractSystem:
    return zoo.system(slider_crank)


@pytest.fixture(scope="module")
def rom(full) -> rj.AbstractSystem:
    return rj.reduce(full, of_one(full), "table")


@pytest.fixture(scope="module")
def exact() -> rj.Trajectory:
    return zoo.motion(slider_crank)


@pytest.fixture(scope="module")
def two() -> rj.Trajectory:
    """A run of the five-bar linkage."""
    return zoo.motion(five_bar)


@pytest.fixture(scope="module")
def surface(two) -> rj.AbstractSystem:
    return rj.reduce(two.system, rj.pod(two, rank=2), "table")


def test_what_is_looked_up_goes_round(exact):
    """More than one round of the crank, both dead points passed."""
    assert np.ptp(exact.q, axis=0)[2] > 2 * np.pi
    assert np.max(exact.violation) <= SOLVED


def test_wrong_settings_are_refused(full):
    with pytest.raises(rj.InputError, match="tol=0"):
        rj.Tabulated(tol=0.0)
    with pytest.raises(ValueError, match="outside of jit"):
        jax.jit(lambda q: rj.reduce(dataclasses.replace(full, q0=q), of_one(full), "table").q0)(
            full.q0
        )


@pytest.mark.slow
def test_a_tolerance_that_no_table_holds_is_refused(full):
    """With one that it holds."""
    with pytest.raises(rj.ReductionError, match="more than tol=1e-15") as refusal:
        rj.reduce(full, of_one(full), rj.Tabulated(tol=1e-15))
    held = float(re.search(r"take tol=(\S+), which it holds", str(refusal.value))[1])
    assert "nodes" in rj.reduce(full, of_one(full), rj.Tabulated(tol=held)).summary


def test_one_coordinate_moves_as_all_do(rom, exact):
    run = zoo.run(rom, TS)
    assert rom.n == 1
    assert rom.m == 0
    assert run.is_valid
    assert rj.compare(exact, run).error <= PUBLISHED
    assert np.max(run.violation) <= SOLVED


@pytest.mark.slow
def test_a_singular_position_ends_a_table_of_two_coordinates():
    """On soft springs the mechanism passes one of every pair of coordinates."""
    soft = zoo.motion(five_bar, end=4.0, spring=0.1)
    with pytest.raises(rj.ReductionError, match="no two coordinates"):
        rj.reduce(soft.system, rj.pod(soft, rank=2), "table")


@pytest.mark.slow
def test_two_coordinates_move_as_all_do(surface, two):
    """And with another mass and spring, on a motion that the table was not made of."""
    run = zoo.run(surface, TS)
    assert (surface.n, surface.m) == (2, 0)
    assert run.is_valid
    assert rj.compare(two, run).error <= PUBLISHED
    assert np.max(run.violation) <= SOLVED
    other = rj.assemble(five_bar(spring=64.0, mass=1.1))
    right = zoo.run(other, TS)
    assert np.max(np.abs(np.subtract(right.q, two.q))) > 1e-2
    moved = zoo.run(surface.with_full(other), TS)
    assert rj.compare(right, moved).error <= PUBLISHED


@pytest.mark.parametrize("freedoms", [1, 2])
def test_configurations_lie_on_the_constraints(freedoms, rom, surface):
    """C = 0, C_q G = 0 and C_q β = γ at random points, of several rounds where the curve is closed,
    to the table's `tol`.
    """
    model = (rom, surface)[freedoms - 1]
    full, lot = model.full, np.random.default_rng(2)
    lengths = model.lift.grid.steps * np.array(model.lift.coefficients.shape[:freedoms])
    low, high = (-2, 3) if freedoms == 1 else (0.1, 0.9)

    @jax.jit
    def violations(z, w):
        motion = model.lift.motion(full, 0.0, z, w)
        state = full.state(0.0, motion.q, motion.v)
        rows = state.jacobian()
        gamma = rj.system.dynamics.gamma(full, 0.0, motion.q, motion.v)
        return full.constraint(0.0, motion.q), rows @ motion.tangent, rows @ motion.bias - gamma

    for _ in range(20):
        z, w = lot.uniform(low, high, freedoms) * lengths, lot.uniform(-1, 1, freedoms)
        position, velocity, acceleration = map(np.asarray, violations(z, w))
        assert np.max(np.abs(position)) <= IDENTITY
        assert np.max(np.abs(velocity)) <= SOLVED
        assert np.max(np.abs(acceleration)) <= 1e-8


def test_derivatives_of_two_coordinates_are_those_of_the_table(surface):
    """G and β against JAX's derivatives of the positions, at a random state."""
    lift, full = surface.lift, surface.full
    z, w = surface.q0 + 0.01, jnp.array([0.3, -0.7])

    @jax.jit
    def both():
        motion = lift.motion(full, 0.0, z, w)
        slope = jax.jacfwd(lambda z: lift.position(full, 0.0, z))
        _, bias = jax.jvp(lambda z: slope(z) @ w, (z,), (w,))
        return (motion.tangent, motion.bias), (slope(z), bias)

    for own, right in zip(*both(), strict=True):
        np.testing.assert_allclose(own, right, atol=SOLVED)


def test_a_start_is_met_in_any_round(full, rom, exact):
    """From the middle of a run, two rounds on: the same motion, two rounds on."""
    number = len(TS) // 2
    turn = np.where(np.arange(full.n) == 2, 4 * np.pi, 0.0)
    there, rate = np.asarray(exact.q)[number] + turn, np.asarray(exact.v)[number]
    later = rom.starting_at(there, rate)
    q, v = jax.jit(lambda rom: rom.reconstruct(0.0, rom.q0, rom.v0))(later)
    np.testing.assert_allclose(q, there, atol=SOLVED)
    np.testing.assert_allclose(v, rate, atol=PUBLISHED)


@pytest.mark.slow
def test_other_masses_need_no_new_table(rom):
    """And the derivative by a mass, in both modes, is that of the full model, by differences."""

    def end(slider, table=True):
        system = rj.assemble(slider_crank(slider=slider))
        system = rom.with_full(system) if table else system
        # Steps of one size, so that differences have no jumps.
        return zoo.run(system, TS[:51], rtol=None, dt=5e-3).q[-1, 0]

    heavier, step = jnp.asarray(1.3), 1e-4
    value, reverse = jax.jit(jax.value_and_grad(end))(heavier)
    with rj.forward_mode():
        forward = jax.jit(jax.jacfwd(end))(heavier)
    below, right, above = (float(end(heavier + x, table=False)) for x in (-step, 0.0, step))
    np.testing.assert_allclose(value, right, atol=PUBLISHED)
    for slope in (forward, reverse):
        np.testing.assert_allclose(slope, (above - below) / (2 * step), rtol=DIFFERENCED)
    nodes = rom.with_full(rj.assemble(slider_crank(slider=1.3))).lift.grid.nodes
    np.testing.assert_array_equal(nodes, rom.lift.grid.nodes)


@pytest.mark.slow
def test_other_lengths_move_the_table(full, rom):
    """Nodes on the constraints of the other mechanism, and their derivative by its length."""
    other = rj.assemble(slider_crank(length=1.1))
    run = zoo.run(rom.with_full(other), TS)
    assert rj.compare(zoo.run(other, TS), run).error <= PUBLISHED

    def node(length):
        return rom.lift.with_full(rj.assemble(slider_crank(length=length))).grid.nodes[40]

    step = 1e-4
    differences = (node(1.1 + step) - node(1.1 - step)) / (2 * step)
    slope = jax.jit(jax.jacfwd(node))(jnp.asarray(1.1))
    np.testing.assert_allclose(slope, differences, atol=DIFFERENCED)


@pytest.mark.slow
def test_small_deflections_are_added_to_second_order():
    """A rod that bends by some thousandths of its length: two modes meet all coordinates, and
    deflections that are ten times larger violate the constraints a thousand times more.
    """
    run = zoo.motion(slider_crank, bends=True)
    rom = rj.reduce(run.system, rj.pod(run, rank=3), "table")
    assert rom.n == 3
    assert rj.compare(run, zoo.run(rom, TS)).error <= DIFFERENCED

    def violation(size):
        z = jnp.array([0.4, size, 0.5 * size])
        return np.max(np.abs(run.system.constraint(0.0, rom.lift.position(run.system, 0.0, z))))

    order = np.log10(violation(1e-1) / violation(1e-2))
    assert order == pytest.approx(3.0, abs=0.1)


@pytest.mark.exhaustive
def test_deflections_of_two_freedoms_are_added_to_second_order():
    """Two links that bend by some thousandths of their length."""
    links = [
        rj.Beam(f"link{i}", mass=0.5, length=0.5, EI=50.0, modes=1, position=(0.25 + 0.5 * i, 0.0))
        for i in range(2)
    ]
    hinges = [rj.ground.at(), links[0].at("end")]
    joints = [rj.Revolute(link.at("start"), at) for link, at in zip(links, hinges, strict=True)]
    system = rj.assemble(rj.Scene(links, joints, [rj.Gravity()]))
    run = zoo.run(system, TS)
    rom = rj.reduce(system, rj.pod(run, rank=4), "table")
    assert rom.n == 4
    assert rj.compare(run, zoo.run(rom, TS)).error <= DIFFERENCED


def test_a_surface_reaches_as_far_as_the_snapshots(surface):
    """Beyond them and a margin there is no result."""
    faster = dataclasses.replace(surface, v0=surface.v0 + 5.0)
    assert not zoo.run(faster, TS, throw=False).success


@pytest.mark.slow
def test_an_open_curve_reaches_as_far_as_the_snapshots():
    """A bead in a parabola: beyond the snapshots and a margin there is no table, and no result."""
    bead = rj.RigidBody("bead", 1.0, 1.0, position=(0.5, 0.25))
    bowl = rj.PointOnCurve(bead.at(), rj.ground.at(), rj.Polynomial([0.0, 0.0, 1.0]))
    joints = [bowl, rj.FixedAngle(bead.at(), rj.ground.at())]
    system = rj.assemble(rj.Scene([bead], joints, [rj.Gravity()]))
    run = zoo.run(system, TS)
    rom = rj.reduce(system, rj.pod(run, rank=1), "table")
    np.testing.assert_allclose(zoo.run(rom, TS).q, run.q, atol=PUBLISHED)
    faster = dataclasses.replace(rom, v0=jnp.array([10.0]))
    assert not zoo.run(faster, TS, throw=False).success
    with pytest.raises(rj.ReductionError, match="does not come back to where it starts"):
        rj.reduce(system, of_one(system), "table")


@pytest.mark.slow
def test_a_straight_rail_has_no_end():
    """What a rail repeats every 2π m is a table of all of it, as a round of a crank is."""
    body = rj.RigidBody("slider", 1.0, 1.0, velocity=(70.0, 0.0))
    spring = rj.Spring(body.at(), rj.ground.at(), 4.0)
    system = rj.assemble(rj.Scene([body], [rj.Prismatic(body.at(), rj.ground.at())], [spring]))
    run = zoo.run(rj.reduce(system, of_one(system), "table"), TS)
    np.testing.assert_allclose(run.q[:, 0], 35 * np.sin(2 * TS), atol=35 * SOLVED)


def parallelogram() -> rj.Scene:
    """It may leave either of its flat positions as an antiparallelogram."""
    points = {"A": (0, 0), "b": (0, 1), "c": (2, 1), "D": (2, 0)}
    return linkage(points, [("A", "b"), ("b", "c"), ("D", "c")], {})


def driven() -> rj.Scene:
    """A double pendulum whose first bar is turned."""
    chain = rj.gallery.chain(2)
    drive = rj.PrescribedAngle(chain.bodies[0].at(), rj.ground.at(), rj.Sine(1.0, 1.0))
    return rj.Scene(chain.bodies, (*chain.joints, drive), chain.effects)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        pytest.param(lambda: rj.gallery.chain(3), "have 3 freedoms", marks=pytest.mark.slow),
        (lambda: rj.gallery.chain(2), "give a basis, whose snapshots"),
        (parallelogram, "configurations branch"),
        pytest.param(driven, "change with time", marks=pytest.mark.slow),
    ],
    ids=["three freedoms", "two without snapshots", "branches", "driven"],
)
def test_what_a_table_cannot_hold_is_refused(scene, message):
    system = rj.assemble(scene())
    with pytest.raises(rj.ReductionError, match=message):
        rj.reduce(system, of_one(system), "table")
