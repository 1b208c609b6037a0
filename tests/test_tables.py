"""Tables: a mechanism with one freedom in one coordinate, against its redundant coordinates."""

import dataclasses

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import TIGHT
from mechanisms import linkage
from tolerances import DIFFERENCED, IDENTITY, PUBLISHED, SOLVED

import romjax as rj

TS = jnp.linspace(0.0, 1.0, 41)
EXACT = {"rtol": TIGHT, "solver": diffrax.Dopri8()}
RADIUS = 0.3


def slider_crank(slider=0.7, length=1.0, turning=9.0, bends=False) -> rj.Scene:
    """A crank that goes round from above, a rod that may bend, and a slider on a spring."""
    reach, along = jnp.sqrt(length**2 - RADIUS**2), jnp.array([-turning * RADIUS, 0.0])
    crank = rj.RigidBody(
        "crank",
        1.0,
        0.02,
        position=(0.0, RADIUS / 2),
        angle=jnp.pi / 2,
        velocity=along / 2,
        angular_velocity=turning,
    )
    # With the crank upright the rod does not turn, and moves as the slider does.
    where = {
        "position": jnp.stack([reach / 2, RADIUS / 2]),
        "angle": -jnp.arcsin(RADIUS / length),
        "velocity": along,
    }
    if bends:
        rod = rj.Beam("rod", mass=0.5, length=length, EI=60.0, modes=2, **where)
    else:
        rod = rj.RigidBody("rod", 0.5, 0.04, **where)
    piston = rj.RigidBody(
        "piston", slider, 0.1, position=jnp.stack([reach, 0.0 * reach]), velocity=along
    )
    half = jnp.stack([length / 2, 0.0 * reach])
    joints = [
        rj.Revolute(crank.at((-RADIUS / 2, 0.0)), rj.ground.at()),
        rj.Revolute(rod.at(-half), crank.at((RADIUS / 2, 0.0))),
        rj.Revolute(piston.at(), rod.at(half)),
        rj.Prismatic(piston.at(), rj.ground.at()),
    ]
    pull = rj.Spring(piston.at(), rj.ground.at((2.0, 0.0)), 20.0, 0.9)
    return rj.Scene([crank, rod, piston], joints, [rj.Gravity(), pull])


def of_one(system) -> rj.Basis:
    """A basis that says nothing but where the system starts."""
    return rj.Basis.from_modes(np.eye(system.n)[:, :1], system.q0)


@pytest.fixture(scope="module")
def full() -> rj.AbstractSystem:
    return rj.assemble(slider_crank())


@pytest.fixture(scope="module")
def rom(full) -> rj.AbstractSystem:
    return rj.reduce(full, of_one(full), "table")


@pytest.fixture(scope="module")
def exact(full) -> rj.Trajectory:
    return rj.simulate(full, TS, **EXACT)


def test_one_coordinate_moves_as_all_do(rom, exact):
    """More than one round of the crank, both dead points passed; energy balances in the audit."""
    run = rj.simulate(rom, TS, **EXACT)
    assert rom.n == 1
    assert rom.m == 0
    assert exact.q[-1, 2] - exact.q[0, 2] > 2 * np.pi
    assert run.is_valid
    assert rj.compare(exact, run).error <= PUBLISHED
    assert np.max(run.violation) <= SOLVED


def test_configurations_lie_on_the_constraints(full, rom):
    """C = 0, C_q G = 0 and C_q β = γ at random points of several rounds, to the table's `tol`."""
    lot = np.random.default_rng(2)
    length = rom.lift.step * len(rom.lift.coefficients)

    @jax.jit
    def violations(z, w):
        motion = rom.lift.motion(full, 0.0, z, w)
        state = full.state(0.0, motion.q, motion.v)
        rows = state.jacobian()
        gamma = rj.system.dynamics.gamma(full, 0.0, motion.q, motion.v)
        return full.constraint(0.0, motion.q), rows @ motion.tangent, rows @ motion.bias - gamma

    for place, speed in zip(lot.uniform(-2, 3, 20), lot.uniform(-1, 1, 20), strict=True):
        z, w = jnp.array([place * length]), jnp.array([speed])
        position, velocity, acceleration = map(np.asarray, violations(z, w))
        assert np.max(np.abs(position)) <= IDENTITY
        assert np.max(np.abs(velocity)) <= SOLVED
        assert np.max(np.abs(acceleration)) <= 10 * rj.Tabulated().tol


def test_a_start_is_met_in_any_round(full, rom, exact):
    """From the middle of a run, two rounds on: the same motion, two rounds on."""
    number = len(TS) // 2
    turn = np.where(np.arange(full.n) == 2, 4 * np.pi, 0.0)
    later = rom.starting_at(exact.q[number] + turn, exact.v[number])
    q, v = later.reconstruct(0.0, later.q0, later.v0)
    np.testing.assert_allclose(q, exact.q[number] + turn, atol=SOLVED)
    np.testing.assert_allclose(v, exact.v[number], atol=PUBLISHED)


@pytest.mark.slow
def test_other_masses_need_no_new_table(full, rom):
    """And the derivative by a mass is that of the full model, in both modes."""

    def end(slider, table, adjoint=None):
        system = rj.assemble(slider_crank(slider=slider))
        system = rom.with_full(system) if table else system
        run = rj.simulate(system, TS, adjoint=adjoint, throw=False, max_steps=1024, **EXACT)
        return run.q[-1, 0]

    heavier, forward = jnp.asarray(1.3), diffrax.ForwardMode()
    np.testing.assert_allclose(end(heavier, True), end(heavier, False), atol=PUBLISHED)
    right = jax.jacfwd(end)(heavier, False, forward)
    np.testing.assert_allclose(jax.jacfwd(end)(heavier, True, forward), right, rtol=DIFFERENCED)
    np.testing.assert_allclose(jax.grad(end)(heavier, True), right, rtol=DIFFERENCED)
    nodes = rom.with_full(rj.assemble(slider_crank(slider=1.3))).lift.nodes
    np.testing.assert_array_equal(nodes, rom.lift.nodes)


@pytest.mark.slow
def test_other_lengths_move_the_table(full, rom):
    """Nodes on the constraints of the other mechanism, and their derivative by its length."""
    other = rj.assemble(slider_crank(length=1.1))
    moved = rom.with_full(other).starting_at(other.q0, other.v0)
    run = rj.simulate(moved, TS, **EXACT)
    assert rj.compare(rj.simulate(other, TS, **EXACT), run).error <= PUBLISHED

    def node(length):
        return rom.lift.with_full(rj.assemble(slider_crank(length=length))).nodes[40]

    step = 1e-4
    differences = (node(1.1 + step) - node(1.1 - step)) / (2 * step)
    slope = jax.jit(jax.jacfwd(node))(jnp.asarray(1.1))
    np.testing.assert_allclose(slope, differences, atol=DIFFERENCED)


@pytest.mark.slow
def test_small_deflections_are_added_to_second_order():
    """A rod that bends by some thousandths of its length: two modes meet all coordinates, and
    deflections that are ten times larger violate the constraints a thousand times more.
    """
    system = rj.assemble(slider_crank(bends=True))
    run = rj.simulate(system, TS, **EXACT)
    rom = rj.reduce(system, rj.pod(run, rank=3), "table")
    assert rom.n == 3
    assert rj.compare(run, rj.simulate(rom, TS, **EXACT)).error <= DIFFERENCED

    def violation(size):
        z = jnp.array([0.4, size, 0.5 * size])
        return np.max(np.abs(system.constraint(0.0, rom.lift.position(system, 0.0, z))))

    order = np.log10(violation(1e-1) / violation(1e-2))
    assert order == pytest.approx(3.0, abs=0.1)


@pytest.mark.slow
def test_an_open_curve_reaches_as_far_as_the_snapshots():
    """A bead in a parabola: beyond the snapshots and a margin there is no table, and no result."""
    bead = rj.RigidBody("bead", 1.0, 1.0, position=(0.5, 0.25))
    bowl = rj.PointOnCurve(bead.at(), rj.ground.at(), rj.Polynomial([0.0, 0.0, 1.0]))
    joints = [bowl, rj.FixedAngle(bead.at(), rj.ground.at())]
    system = rj.assemble(rj.Scene([bead], joints, [rj.Gravity()]))
    run = rj.simulate(system, TS, **EXACT)
    rom = rj.reduce(system, rj.pod(run, rank=1), "table")
    np.testing.assert_allclose(rj.simulate(rom, TS, **EXACT).q, run.q, atol=PUBLISHED)
    faster = dataclasses.replace(rom, v0=jnp.array([10.0]))
    assert not rj.simulate(faster, TS, throw=False).success
    with pytest.raises(rj.ReductionError, match="does not come back to where it starts"):
        rj.reduce(system, of_one(system), "table")


@pytest.mark.slow
def test_a_straight_rail_has_no_end():
    """What a rail repeats every 2π m is a table of all of it, as a round of a crank is."""
    body = rj.RigidBody("slider", 1.0, 1.0, velocity=(70.0, 0.0))
    spring = rj.Spring(body.at(), rj.ground.at(), 4.0)
    system = rj.assemble(rj.Scene([body], [rj.Prismatic(body.at(), rj.ground.at())], [spring]))
    run = rj.simulate(rj.reduce(system, of_one(system), "table"), TS, **EXACT)
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
        (lambda: rj.gallery.chain(2), "have 2 freedoms"),
        (parallelogram, "configurations branch"),
        (driven, "change with time"),
    ],
    ids=["two freedoms", "branches", "driven"],
)
def test_what_a_table_cannot_hold_is_refused(scene, message):
    system = rj.assemble(scene())
    with pytest.raises(rj.ReductionError, match=message):
        rj.reduce(system, of_one(system), "table")


def test_wrong_settings_are_refused(full):
    with pytest.raises(rj.InputError, match="tol=0"):
        rj.Tabulated(tol=0.0)
    with pytest.raises(rj.ReductionError, match="more than tol=1e-15"):
        rj.reduce(full, of_one(full), rj.Tabulated(tol=1e-15))
    with pytest.raises(ValueError, match="outside of jit"):
        jax.jit(lambda q: rj.reduce(dataclasses.replace(full, q0=q), of_one(full), "table").q0)(
            full.q0
        )
