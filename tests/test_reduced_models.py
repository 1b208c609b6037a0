"""What every reduced model is: as many coordinates as modes, the same elsewhere, by any name."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from test_monitors import Last
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.reduction.lift.atlas import AtlasLift
from romjax.system.base import beginning_at

RANKS = {"galerkin": 5, "minimal": 3}
FORMULATIONS = {"galerkin": rj.Galerkin, "minimal": rj.Minimal}
# The fast tests ask this of the one whose coordinates have a chart.
IN_A_CHART = pytest.mark.parametrize(
    "model", in_groups(RANKS, fast=["minimal"], slow=["galerkin"]), indirect=True
)
# Of the cart-pendulum in half a second: what POD's modes err at most.
ERROR = 1e-6
# The same decisions made elsewhere, against those made again: share of the reduction's own error.
AGAIN = 0.3
# From a snapshot on: what the subspace misses of it and the reduction adds.
STARTED = 1e-6


def simulate(rom, ts, rtol=1e-8):
    return zoo.run(rom, ts, rtol=rtol, throw=False)


@pytest.fixture(scope="module")
def motion(cart_pendulum):
    return zoo.run(cart_pendulum, np.linspace(0.0, 0.5, 101), solver=zoo.RODAS5P)


@pytest.fixture(scope="module")
def models(cart_pendulum, motion):
    """A basis and a reduced model by the name of the formulation."""
    bases = {name: rj.pod(motion, rank=rank) for name, rank in RANKS.items()}
    return {
        name: (basis, rj.reduce(cart_pendulum, basis, FORMULATIONS[name]()))
        for name, basis in bases.items()
    }


@pytest.fixture(params=RANKS)
def model(models, request):
    return models[request.param]


@pytest.fixture(scope="module")
def turning():
    """A four-bar that goes all the way round, and its one coordinate in several charts."""
    motion = zoo.motion(zoo.four_bar, 2.0)
    rom = rj.reduce(zoo.system(zoo.four_bar), rj.pod(motion), "minimal")
    return motion, rom, zoo.run(rom, motion.t)


def largest(x) -> float:
    return float(np.max(np.abs(x)))


# As many coordinates as modes.


def test_a_model_has_as_many_coordinates_as_modes(model):
    basis, rom = model
    counts = {rom.n, len(rom.q0), len(rom.v0), len(rom.structure.coordinates)}
    assert counts == {basis.modes.shape[1]}
    assert rom.degrees_of_freedom == rom.n - rom.m


@pytest.mark.slow
def test_a_model_in_charts_has_as_many_coordinates_as_modes(turning):
    """The number of the chart is none of them."""
    motion, rom, run = turning
    assert isinstance(rom.lift, AtlasLift)
    assert (rom.n, rom.q0.shape, rom.m, rom.degrees_of_freedom) == (1, (1,), 0, 1)
    charts = {int(rom.lift.number(q)) for q in run.q}
    assert len(charts) >= 2, "the motion stays in one chart"
    error = float(rj.compare(motion, run).error)
    assert error <= 10 * SOLVED, f"{error:.1e}"


@pytest.mark.slow
def test_numbers_of_charts_do_not_change_the_steps(turning):
    """Numbered the other way round, charts change by other amounts: in an error norm, these would
    reject steps.
    """
    motion, rom, run = turning
    lift = rom.lift
    last = len(lift.lifts.offset) - 1
    reversed_lift = dataclasses.replace(
        lift,
        lifts=jax.tree.map(lambda x: x[::-1], lift.lifts),
        current=last - lift.current,
        owners=last - lift.owners,
    )
    other = zoo.run(dataclasses.replace(rom, lift=reversed_lift), motion.t)
    assert last >= 1
    assert int(other.stats.num_steps) == int(run.stats.num_steps)
    assert largest(other.q - run.q) <= SOLVED, f"apart by {largest(other.q - run.q):.1e}"


# The same reduction elsewhere.


def varied(f1=16.5) -> rj.AbstractSystem:
    return rj.assemble(rj.gallery.cart_pendulum(f1=f1, cart_mass=1.1))


@IN_A_CHART
def test_the_same_reduction_of_another_system(model, motion):
    """Against reducing that system with the same decisions, and against its full motion."""
    basis, rom = model
    decided = rj.Galerkin(rom.m) if rom.m else rj.Minimal(rom.lift.chart)
    system = varied()
    truth = zoo.run(system, motion.t, solver=zoo.RODAS5P)
    same = simulate(rom.with_full(system), motion.t)
    again = simulate(rj.reduce(system, basis, decided), motion.t)
    error = float(rj.compare(truth, same).error)
    apart = float(rj.compare(again, same).error)
    changed = float(rj.compare(motion, truth).error)
    assert error <= ERROR, f"{error:.1e}"
    assert apart <= AGAIN * error, f"apart by {apart:.1e}, error {error:.1e}"
    assert changed >= 1e-2, f"the other system moves alike, to {changed:.1e}"


@IN_A_CHART
def test_other_numbers_are_the_same_program(model):
    """Structure and types stay, and under jit and vmap nothing is traced for another number."""
    _, rom = model
    other, traced = rom.with_full(varied()), []
    assert jax.tree.structure(other) == jax.tree.structure(rom)
    for one, two in zip(jax.tree.leaves(rom), jax.tree.leaves(other), strict=True):
        assert jnp.shape(one) == jnp.shape(two)
        assert jnp.result_type(one) == jnp.result_type(two)

    def slowest(f1):
        traced.append(f1)
        local = rom.with_full(varied(f1))
        return local.acceleration(0.0, local.q0 + 0.01, local.v0)[0]

    single = jax.jit(slowest)
    numbers = np.array([15.0, 16.0, 17.0])
    rows = np.stack([single(f1) for f1 in numbers])
    assert len(traced) == 1
    batch = jax.jit(jax.vmap(slowest))
    assert largest(batch(numbers) - rows) <= IDENTITY * largest(rows)
    assert largest(batch(numbers + 1) - rows) > 0
    assert len(traced) == 2


@pytest.mark.exhaustive
def test_a_gradient_through_another_system(models):
    """By the pendulum's first frequency."""
    _, rom = models["minimal"]
    ts = jnp.linspace(0.0, 0.1, 3)

    def angle(f1):
        return simulate(rom.with_full(varied(f1)), ts, zoo.TIGHT).q[-1, 5]

    check = rj.check_gradient(angle, 16.0)
    assert check.error <= DIFFERENCED, f"\n{check}"
    assert abs(float(check.reverse)) >= 1e-6


@IN_A_CHART
def test_another_system_begins_where_it_does(model, motion):
    """And a start that was given stays as far from that of the system."""
    _, rom = model
    system = varied()
    there = beginning_at(system, motion.q[40], motion.v[40])
    moved, wanted = rom.with_full(there), rom.with_full(system).starting_at(there.q0, there.v0)
    later = rom.starting_at(motion.q[20], motion.v[20], motion.t[20])
    for one, other in ((moved, wanted), (later.with_full(rom.full), later)):
        assert_close(one.q0, other.q0, SOLVED)
        assert_close(one.v0, other.v0, SOLVED)
    assert float(later.with_full(there).time) == motion.t[20]
    assert largest(moved.q0 - rom.q0) >= 1e-3


def four_bar_of(b, c, D):
    points = {"A": (0, 0), "b": b, "c": c, "D": D}
    return rj.assemble(zoo.linkage(points, [("A", "b"), ("b", "c"), ("D", "c")], {}, gravity=True))


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["joint", "minimal"])
def test_other_lengths_begin_where_they_are_put_together(formulation):
    """Where the first mechanism starts, the motion is another one, by 0.7 of its size."""
    first = four_bar_of((0.3, 0.9), (1.8, 1.3), (2.0, 0))
    other = four_bar_of((0.35, 0.95), (1.9, 1.2), (2.1, 0))
    ts = np.linspace(0.0, 0.75, 31)
    basis = None
    if formulation == "minimal":
        basis = rj.Minimal().basis(first, zoo.run(first, ts, rtol=1e-8), rj.POD(rank=1))
    rom, truth = rj.reduce(first, basis, formulation), zoo.run(other, ts, rtol=1e-8)

    def moved(other):
        return zoo.run(rom.with_full(other), ts, rtol=1e-8, throw=False)

    for run in (moved(other), eqx.filter_jit(moved)(other)):
        error = float(rj.compare(truth, run).error)
        assert error <= 1e-6, f"{error:.1e}"


@pytest.mark.slow
def test_starts_in_space_are_moved_by_turns():
    """Quaternions stay of unit length, and orthogonal to their rates."""
    first = rj.assemble(rj.gallery.spinning_top())
    run = zoo.run(first, np.linspace(0.0, 0.02, 3))
    there, rom = beginning_at(first, run.q[2], run.v[2]), rj.reduce(first, formulation="joint")
    moved, later = rom.with_full(there), rom.starting_at(run.q[2], run.v[2])
    beyond = later.with_full(there)
    for one, other in ((moved, later), (later.with_full(first), later)):
        assert_close(one.q0, other.q0, SOLVED)
        assert_close(one.v0, other.v0, SOLVED, largest(other.v0))
    assert largest(moved.q0 - rom.q0) >= 1e-1
    assert_close(jnp.linalg.norm(beyond.q0), 1.0, SOLVED)
    assert_close(beyond.q0 @ beyond.v0, 0.0, SOLVED, largest(beyond.v0))


def test_a_system_of_another_size_is_refused(model):
    with pytest.raises(rj.ReductionError, match=r"6 coordinates and 4 constraints cannot take"):
        model[1].with_full(rj.assemble(rj.gallery.chain(2)))


@pytest.mark.slow
def test_another_start(model, motion):
    _, rom = model
    k = 40
    later = rom.starting_at(motion.q[k], motion.v[k], motion.t[k])
    run = simulate(later, motion.t[k:])
    assert float(later.time) == motion.t[k]
    error = largest(run.q - motion.q[k:])
    assert error <= STARTED, f"{error:.1e} m or rad"


@pytest.mark.slow
def test_another_start_in_another_chart(turning):
    motion, rom, _ = turning
    k = next(k for k, q in enumerate(motion.q) if rom.lift.number(q) != rom.lift.current)
    later = rom.starting_at(motion.q[k], motion.v[k], motion.t[k])
    assert int(later.lift.current) == int(rom.lift.number(motion.q[k])) != int(rom.lift.current)
    q, v = later.reconstruct(later.time, later.q0, later.v0)
    # Projected, the full run's outputs move by what they violate.
    assert largest(q - motion.q[k]) <= 10 * SOLVED, f"{largest(q - motion.q[k]):.1e}"
    assert largest(v - motion.v[k]) <= 100 * SOLVED, f"{largest(v - motion.v[k]):.1e}"


# Names that do not exist.


def test_formulations_that_do_not_exist(cart_pendulum, models):
    words = r"formulation='galrkin'.*\"galerkin\".*\"minimal\".*\"projected\".*romjax\.Galerkin\(\)"
    with pytest.raises(rj.ReductionError, match=words):
        rj.reduce(cart_pendulum, models["galerkin"][0], "galrkin")
    with pytest.raises(TypeError, match="unexpected keyword argument 'modes'"):
        rj.reduce(cart_pendulum, models["galerkin"][0], modes=3)


def test_a_system_without_constraints_is_reduced():
    """Two masses on springs, in the one mode that the snapshots have; monitors see both."""
    springs = zoo.oscillator((2.0, 2.0))
    motion = zoo.run(springs, np.linspace(0.0, 1.0, 21))
    rom = rj.reduce(springs, rj.pod(motion, rank=1, offset=np.zeros(2)))
    assert (rom.n, rom.m) == (1, 0)
    run = zoo.run(rom, motion.t, follow=[Last()])
    error = float(rj.compare(motion, run).error)
    assert error <= 10 * SOLVED, error
    assert largest(run.followed[0].q - run.q[-1]) <= IDENTITY
