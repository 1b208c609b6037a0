"""Hyper-reduction: a few bodies and angles of a chain stand for all, and energy is conserved."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from motions import through
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax.compiling import jaxprs
from romjax.linalg.branches import Branches, Forest, inverted
from romjax.reduction.charts import choose
from romjax.scene.counted_angle import counted_angle

TS = np.linspace(0.0, 0.5, 41)
COUNT = 16
# Of runs, for the tolerance of virtual work, inertia and rotations.
ERROR = 10 * rj.HyperReduced().tol


def chain(mass=1.0, pull=2.0) -> rj.Scene:
    """A beam of bars on hinges with springs and dampers, falling, its end on a soft spring."""
    size = 1 / COUNT
    bodies = [
        rj.RigidBody(f"bar{i}", mass * size, size**3 / 12, ((i + 0.5) * size, 0.0))
        for i in range(COUNT)
    ]
    ends = [rj.ground.at(), *(body.at((size / 2, 0.0)) for body in bodies)]
    starts = [body.at((-size / 2, 0.0)) for body in bodies]
    hinges = [rj.Revolute(a, b) for a, b in zip(starts, ends, strict=False)]
    bending = [
        rj.TorsionSpring(a, b, 1.0 * COUNT) for a, b in zip(starts[1:], ends[1:-1], strict=True)
    ]
    damping = [rj.TorsionDamper(a, b, 0.02) for a, b in zip(starts[1:], ends[1:-1], strict=True)]
    tip = rj.Spring(ends[-1], rj.ground.at((1.0, 0.5)), pull, 0.4)
    return rj.Scene(bodies, hinges, [rj.Gravity(), *bending, *damping, tip])


@pytest.fixture(scope="module")
def system() -> rj.AbstractSystem:
    return rj.assemble(chain())


@pytest.fixture(scope="module")
def basis(system) -> rj.Basis:
    return rj.Minimal().basis(system, zoo.run(system, TS, rtol=1e-8), rj.POD(3))


@pytest.fixture(scope="module")
def minimal(system, basis) -> rj.AbstractSystem:
    return rj.reduce(system, basis, "minimal")


@pytest.fixture(scope="module")
def rom(system, basis) -> rj.AbstractSystem:
    return rj.reduce(system, basis, "hyper")


def states(rom, count, wider=2.0):
    """Random z in a box wider than that of the training, and w alike."""
    lower, upper = np.asarray(rom.validity.box.lower), np.asarray(rom.validity.box.upper)
    middle, half = (lower + upper) / 2, wider * (upper - lower) / 2
    lot = np.random.default_rng(3).uniform(-1, 1, (2, count, rom.n))
    return middle + half * lot[0], 5 * half * lot[1]


def test_a_chart_is_chosen_once(system, basis, minimal, monkeypatch):
    """And kept with the basis."""
    monkeypatch.setattr(choose, "_best", None)
    rj.reduce(system, basis, "minimal")


@pytest.mark.slow
def test_few_bodies_and_angles_stand_for_all(rom):
    weights = np.concatenate(rom.sample.weights)
    assert np.all(weights >= 0)
    assert np.sum(weights > 0) < COUNT
    assert len(rom.sample.rotations.sampled) < COUNT
    # The springs and dampers in the hinges are linear, the spring at the end is not.
    assert (len(rom.sample.linear), len(rom.sample.others)) == (2, 1)
    np.testing.assert_allclose(rom.loads.stiffness, rom.loads.stiffness.T, atol=IDENTITY)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0, 0))
def energies(rom, z, w):
    found = rom.state(0.0, z, w).energy()
    return found.total, found.kinetic


@pytest.mark.slow
def test_it_is_a_reduced_system_like_any_other(rom, minimal):
    """The motion and the energies are those of the model that is not sampled."""
    assert (rom.n, rom.m) == (3, 0)
    right, run = (zoo.run(one, TS) for one in (minimal, rom))
    # What three modes leave out is none of the sample's.
    assert right.flags == run.flags == rj.Flag.LEFT_OUT
    assert rj.compare(right, run).error <= ERROR
    places = states(rom, 50, wider=1.0)
    (found, _), (wanted, kinetic) = energies(rom, *places), energies(minimal, *places)
    assert_close(found, wanted, ERROR, np.max(kinetic))
    assert np.max(run.violation) <= IDENTITY


def test_the_mass_is_positive_definite_beyond_the_training(rom):
    """At a thousand random states, in twice the box of the snapshots."""
    masses = np.asarray(jax.jit(jax.vmap(rom.mass))(states(rom, 1000)[0]))
    assert_close(masses, np.swapaxes(masses, 1, 2), IDENTITY)
    assert np.min(np.linalg.eigvalsh(masses)) > 0


def test_energy_changes_by_the_power_of_the_dampers(rom):
    """dE/dt of the sampled Lagrangian, by its own derivatives, at random states."""

    @jax.jit
    def balance(z, w):
        state = rom.state(0.0, z, w)
        energy, power = state.energy(), state.power()
        a = rom.acceleration(0.0, z, w)[0]
        rate = jax.jvp(lambda z, w: rom.state(0.0, z, w).energy().total, (z, w), (w, a))[1]
        return rate - power.total, energy.kinetic * 10

    left, size = jax.vmap(balance)(*states(rom, 20))
    assert_close(left, 0.0, 1e3 * IDENTITY, np.max(np.abs(size)))


@pytest.mark.slow
def test_other_numbers_need_no_new_sample(system, rom):
    """And derivatives of a run by a mass and a stiffness are those of differences."""

    @jax.jit
    @jax.value_and_grad
    def tip(numbers):
        other = rom.with_full(rj.assemble(chain(numbers[0], numbers[1])))
        run = zoo.run(other, TS[:9], dt=5e-3, rtol=None)
        return run.q[-1, -2] + run.v[-1, -1]

    numbers, step = np.array([1.1, 2.2]), 1e-4
    reverse = np.asarray(tip(numbers)[1])
    differences = [
        (float(tip(numbers + step * unit)[0]) - float(tip(numbers - step * unit)[0])) / (2 * step)
        for unit in np.eye(2)
    ]
    assert_close(differences, reverse, DIFFERENCED, np.max(np.abs(reverse)))
    heavier = rom.with_full(rj.assemble(chain(1.1, 2.2)))
    np.testing.assert_array_equal(heavier.sample.weights[0], rom.sample.weights[0])


def test_weights_for_other_masses_are_flagged(rom):
    """They stand for bodies that are all as heavier, but not for one that is, by a percent."""
    every = rom.with_full(rj.assemble(chain(mass=1.05)))
    assert not zoo.run(every, TS).flags & rj.Flag.WEIGHTS
    scene = chain()
    one = scene.bodies[COUNT // 3]
    heavier = rj.Scene(
        [
            rj.RigidBody(b.name, b.mass * (1.01 if b is one else 1.0), b.inertia, b.position)
            for b in scene.bodies
        ],
        scene.joints,
        scene.effects,
    )
    run = zoo.run(rom.with_full(rj.assemble(heavier)), TS)
    assert run.flags == rj.Flag.WEIGHTS | rj.Flag.LEFT_OUT
    assert "weights are for other masses" in run.warnings()


def test_what_no_snapshot_shows_is_not_linear():
    """A stop that none touches, and friction that is saturated in all."""
    bar = rj.RigidBody("bar", 1.0, 1.0, angle=1.0, angular_velocity=1.0)
    ends = bar.at(), rj.ground.at()
    effects = [
        rj.JointSpring(*ends, stiffness=2.0),
        rj.JointStop(*ends, None, 1.6, 100.0),
        rj.JointDamper(*ends, friction=rj.Friction(0.3, 1e-3)),
    ]
    full = rj.assemble(rj.Scene([bar], [rj.Revolute(*ends)], effects))
    turn = np.array([0.0, 0.0, 1.0])
    run = through(full, TS, np.outer(1 + TS, turn), np.outer(np.ones_like(TS), turn))
    rom = rj.reduce(full, rj.pod(run, rank=1), "hyper")
    assert (rom.sample.linear, rom.sample.others) == ((0,), (1, 2))

    @jax.jit
    def power(q, v):
        z, w = rom.restrict(q, v)
        return rom.state(0.0, z, w).force() @ w

    torque = -2.0 * 2.0 - 100.0 * (2.0 - 1.6) - 0.3 * np.tanh(1.0)
    assert_close(power(2 * turn, 1e-3 * turn) / 1e-3, torque, IDENTITY, 100.0)


class Bumper(rj.TorsionSpring):
    """A spring of the user's own, which acts on one side and does not say that it begins."""

    def energy(self, t, *poses):
        beyond = counted_angle(*poses) - self.rest_angle
        return 0.5 * self.stiffness * jnp.maximum(beyond, 0) ** 2


def test_what_few_snapshots_show_is_not_linear():
    bar = rj.RigidBody("bar", 1.0, 1.0, angle=1.0, angular_velocity=1.0)
    ends = bar.at(), rj.ground.at()
    effects = [rj.TorsionSpring(*ends, 2.0), Bumper(*ends, 100.0, 1.47)]
    full = rj.assemble(rj.Scene([bar], [rj.Revolute(*ends)], effects))
    turn = np.array([0.0, 0.0, 1.0])
    run = through(full, TS, np.outer(1 + TS, turn), np.outer(np.ones_like(TS), turn))
    rom = rj.reduce(full, rj.pod(run, rank=1), "hyper")
    assert (rom.sample.linear, rom.sample.others) == ((0,), (1,))


@pytest.mark.slow
def test_runs_stop_where_those_of_the_minimal_model_do():
    """And are flagged alike, in the same steps: both hold laws to one side of a stop."""
    bar = rj.RigidBody("bar", 1.0, 1.0, angular_velocity=1.0)
    ends = bar.at(), rj.ground.at()
    effects = [rj.JointSpring(*ends, stiffness=1.0), rj.JointStop(*ends, None, 0.7, 100.0)]
    full = rj.assemble(rj.Scene([bar], [rj.Revolute(*ends)], effects))
    ts = np.linspace(0.0, 20.0, 41)
    basis = rj.pod(rj.simulate(full, ts, audit=False), rank=1)
    models = (rj.reduce(full, basis, kind) for kind in ("hyper", "minimal"))
    found, right = (rj.simulate(model, ts, audit=False) for model in models)
    assert rj.compare(right, found).error <= ERROR
    assert found.flags == right.flags == rj.Flag.NONE
    assert int(found.stats.num_steps) == int(right.stats.num_steps)


def test_its_runs_are_functions_without_calls_of_a_library(rom):
    """Each call would cost as much as a right-hand side."""
    with rj.forward_mode():
        run = jax.make_jaxpr(lambda ts: zoo.run(rom, ts).q)(TS)
    steps = [e for e in jaxprs.equations(run.jaxpr) if e.primitive.name == "while"]
    inner = [e for loop in steps for e in jaxprs.equations(loop.params["body_jaxpr"].jaxpr)]
    assert {e.primitive.name for e in inner if not jaxprs.is_written_out(e)} == set()
    assert len(inner) > 100


def test_what_it_is_not_for_is_refused(system, basis, rom):
    with pytest.raises(rj.InputError, match="tol=0"):
        rj.HyperReduced(tol=0.0)
    given = rj.Basis.from_modes(basis.modes, basis.offset, basis.snapshots.metric)
    with pytest.raises(rj.ReductionError, match="given modes lack"):
        rj.reduce(system, given, "hyper")
    with pytest.raises(ValueError, match="outside of jit"):
        jax.jit(lambda q: rj.reduce(dataclasses.replace(system, q0=q), basis, "hyper").q0)(
            system.q0
        )
    beam = rj.assemble(
        rj.Scene([rj.Beam("beam", mass=1.0, length=1.0, frequencies=[30.0])], [], [rj.Gravity()])
    )
    q = np.asarray(beam.q0) + np.outer(TS[:3], np.ones(beam.n))
    short = through(beam, TS[:3], q, np.ones_like(q))
    with pytest.raises(rj.ReductionError, match="bodies that deform"):
        rj.reduce(beam, rj.pod(short, rank=1), "hyper")


def test_sums_along_branches_invert_a_forest():
    """A tree of twenty unknowns that ends in two roots, with entries of any size."""
    lot, size = np.random.default_rng(4), 20
    matrix = np.diag(lot.uniform(1, 2, size))
    links = [*((i + 1, i) for i in range(11)), (13, 12), (14, 12), (19, 14)]
    for child, parent in links:
        matrix[child, parent] = lot.uniform(-2, -1)
    order = lot.permutation(size)
    matrix = matrix[lot.permutation(size)][:, order]
    forest = Forest.of(matrix)
    right = lot.normal(size=(size, 3))

    @jax.jit
    def solved(matrix, right):
        inverse = inverted(matrix, forest)
        assert isinstance(inverse, Branches)
        return inverse.apply(right)

    wanted = np.linalg.solve(matrix, right)
    assert_close(solved(matrix, right), wanted, 1e2 * IDENTITY, np.max(np.abs(wanted)))
    assert Forest.of(matrix + 0.1) is None
