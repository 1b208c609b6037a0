"""The error of a reduced run, by models that know more: the larger change is taken."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from groups import in_groups

import romjax as rj
from romjax.common.partition import Partitioned
from romjax.integrate.error_bar import ErrorBar
from romjax.reduction.formulation.parse import as_formulation
from romjax.study.errors import richer_run
from romjax.study.errors.richer import finer_of
from romjax.system.training import with_error

# Required of estimates over true errors.
LEAST, MOST = 0.9, 1.1
# Of a change from one cap to twice the cap, which is three quarters of the error.
CAPPED = 0.7


def model(make, formulation, rank, **numbers):
    """The model of so many modes that is made of a motion of the zoo."""
    motion, chosen = zoo.motion(make, **numbers), as_formulation(formulation)
    basis = chosen.basis(motion.system, motion, rj.POD(rank))
    return rj.reduce(motion.system, basis, chosen)


def spun(system, spin):
    """The system from a start with another rate about the origin."""
    v = np.array(system.v0)
    frames = [own[:3] for group in system.bodies for own in group.coordinates.rows]
    for x, y, angle in frames:
        v[x] -= spin * system.q0[y]
        v[y] += spin * system.q0[x]
        v[angle] += spin
    return dataclasses.replace(system, v0=jnp.asarray(v))


@pytest.mark.parametrize(
    ("error", "words", "flag"),
    [
        (5.2e-3, "5.2e-3 estimated (local, 8 modes)", 0),
        (0.06, "more than 5 %: not to be used (local, 8 modes)", rj.Flag.ESTIMATE),
        (np.inf, "more than 5 %: not to be used (local, 8 modes)", rj.Flag.ESTIMATE),
        (np.nan, "more than 5 %: not to be used (local, 8 modes)", rj.Flag.ESTIMATE),
    ],
)
def test_an_error_in_words(error, words, flag):
    bar = ErrorBar(np.asarray(error), "local, 8 modes")
    assert bar.describe() == words
    blind = ErrorBar(np.asarray(error), "local, 8 modes", blind="joint forces")
    assert blind.describe() == words + "; not of joint forces" * (not flag)
    assert bar.flags == flag


# One of each kind.
FEW = [
    # One mode has no more freedoms than the model.
    (zoo.cart_pendulum, "minimal", 3, ["local, 2 modes"]),
    (zoo.falling_beams, "minimal", 2, ["local, 3 modes"]),
    (zoo.falling_beams, "local", 2, ["local, 5 modes"]),
    (zoo.bars, "hyper", 1, ["minimal, 2 modes"]),
    # All freedoms are there.
    (zoo.five_bar, "minimal", 2, []),
]
RICHER = [
    *FEW,
    (zoo.cart_pendulum, "minimal", 2, ["local, 1 modes"]),
    (zoo.cart_pendulum, "local", 1, ["local, 2 modes"]),
    (zoo.bars, "minimal", 1, ["minimal, 2 modes"]),
]


@pytest.mark.parametrize(("make", "formulation", "rank", "names"), in_groups(RICHER, slow=FEW))
def test_richer_kinds(make, formulation, rank, names):
    rom = model(make, formulation, rank)
    found = finer_of(rom)
    assert [one.name for one in found] == names
    assert finer_of(rom) is found  # made once
    other = with_error(rom, 0.5)
    assert finer_of(other) is found
    assert other.validity.error == 0.5


# With another mode in each body, for joint forces.
SPARE = [
    (zoo.falling_beams, "minimal", 2, ["local, 6 modes"]),
    (zoo.falling_beams, "local", 3, []),
    (zoo.cart_pendulum, "minimal", 2, []),
    # Two more of them than twice the rank, if there are.
    (zoo.bars, "hyper", 1, ["minimal, 2 modes"]),
]


@pytest.mark.parametrize(("make", "formulation", "rank", "names"), in_groups(SPARE, slow=SPARE[1:]))
def test_richer_kinds_with_a_mode_to_spare(make, formulation, rank, names):
    """None stands for the full system, where these are all modes."""
    assert [one.name for one in finer_of(model(make, formulation, rank), spare=1)] == names


@pytest.mark.parametrize("spin", in_groups([0.01, 0.1, 2.0], slow=[0.1, 2.0]))
def test_the_error_of_a_run_from_another_start(spin):
    """Of the norm and of what is measured, at any size of error."""
    rom = model(zoo.falling_beams, "minimal", 2)
    system = spun(rom.full, spin)
    own = rom.with_full(system).starting_at(system.q0, system.v0)
    ts = np.linspace(0.0, 1.0, 101)
    truth = zoo.run(system, ts, solver=zoo.RODAS5P)
    run = zoo.run(own, ts, rtol=1e-8)
    corrected = rj.corrected(own, run)
    error = float(rj.compare(truth, run).error)
    assert LEAST <= float(rj.compare(corrected, run).error) / error <= MOST
    assert bool(corrected.flags & rj.Flag.ESTIMATE) == (error > 0.05)
    assert ("not to be used" in corrected.summary()) == (error > 0.05)
    assert "(local, 6 modes)" in corrected.summary()
    # What is kept of one start serves no other one.
    slower = zoo.run(own, ts, v0=0.5 * own.v0, rtol=1e-8)
    told = rj.corrected(own, slower)
    apart = np.linalg.norm(slower.v[0] - run.v[0])
    assert np.linalg.norm(told.v[0] - slower.v[0]) <= 0.1 * apart
    assert np.array_equal(rj.corrected(own, run).q, corrected.q)
    tip = zoo.falling_beams().bodies[-1].at((0.5, 0.0))
    measured = rj.measure(own, run, tip, error=True)
    right = rj.measure(system, truth, tip).position[-1]
    true, estimated = np.abs(right - measured.position[-1]), measured.error.position[-1]
    assert LEAST <= np.linalg.norm(estimated) / np.linalg.norm(true) <= MOST
    data = run.to_xarray(error=True)
    assert np.array_equal(data["q_error"], np.abs(corrected.q - run.q))
    assert "(local, 6 modes)" in data.attrs["error_words"]


@pytest.mark.slow
def test_the_error_of_a_cap():
    system = rj.assemble(rj.cap(zoo.cart_pendulum(), 40.0))
    ts = np.linspace(0.0, 1.0, 101)
    run = zoo.run(system, ts, rtol=1e-8)
    truth = zoo.motion(zoo.cart_pendulum)
    corrected = rj.corrected(system, run)
    effectivity = float(corrected.bar.error / rj.compare(truth, run).error)
    assert CAPPED <= effectivity <= 1.0
    assert "(twice the cap); not of joint forces: for these take by=full" in corrected.summary()
    full = zoo.system(zoo.cart_pendulum)
    exact = rj.corrected(system, run, by=full)
    assert LEAST <= float(exact.bar.error / rj.compare(truth, run).error) <= MOST
    assert near_in_force((full, truth), (system, run), (full, exact))
    # Of the run itself, where it starts elsewhere than its system.
    q, v = rj.consistent(system, run.q[50], run.v[50])
    later = rj.corrected(system, zoo.run(system, ts, q0=q, v0=v, rtol=1e-8))
    assert np.array_equal(later.q[0], q)
    with pytest.raises(rj.InputError, match="has a cap, and 8; give the full system without"):
        rj.corrected(system, run, by=zoo.system(zoo.bar))


def largest_force(system, run):
    forces = rj.joint_forces(system, run).stacked
    return max(float(np.max(np.linalg.norm(one.force, axis=-1))) for one in forces)


def near_in_force(true, own, told):
    """Whether the error of the largest joint force is told within a factor of two."""
    right, force, estimate = (largest_force(*pair) for pair in (true, own, told))
    return 0.5 <= abs(estimate - force) / abs(right - force) <= 2.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "formulation", "rank", "spin"),
    [(zoo.falling_beams, "local", 3, 0.1), (zoo.cart_pendulum, "minimal", 3, 0.0)],
)
def test_the_error_of_the_largest_joint_force(make, formulation, rank, spin):
    """Vibrations carry it that hardly move anything, of modes that are left out, or that an
    implicit method steps over at the tolerance of the run.
    """
    rom = model(make, formulation, rank)
    system = spun(rom.full, spin) if spin else rom.full
    own = rom.with_full(system).starting_at(system.q0, system.v0)
    ts = np.linspace(0.0, 1.0, 101)
    truth, run = zoo.run(system, ts), rj.simulate(own, ts, rtol=1e-8, audit=False)
    told = rj.corrected(own, run)
    assert "(the full model)" in told.summary()
    assert near_in_force((system, truth), (own, run), (system, told))


@pytest.mark.parametrize(("rtol", "sharper"), [(1e-8, 1e-10), (1e-13, 1e-13)])
def test_a_method_that_fails_leaves_its_task_to_the_other(rtol, sharper, monkeypatch):
    """An explicit one where stiffness comes after the start; no tolerance is below rounding."""
    motion, asked = zoo.motion(zoo.bars), []
    stats, method = dataclasses.replace(motion.stats, rtol=rtol), Partitioned.of(zoo.RODAS5P)
    motion = dataclasses.replace(motion, stats=stats, solver_parts=method)

    def simulated(model, run, rtol=None, solver=None):
        asked.append((rtol, solver))
        failed = jnp.full_like(run.status, rj.Status.MAX_STEPS)
        return run if solver is None else dataclasses.replace(run, status=failed)

    monkeypatch.setattr(richer_run, "simulated", simulated)
    monkeypatch.setattr(richer_run, "_can_follow", lambda *_: True)
    told = richer_run.told_by(motion.system, motion, "the full model")
    assert [one for one, _ in asked] == [1e-6, pytest.approx(sharper), None]
    assert [solver is None for _, solver in asked] == [True, False, True]
    assert told.bar.error == 0.0
    assert told.success


@pytest.mark.slow
def test_a_model_of_all_freedoms_is_judged_by_the_full_one():
    motion = zoo.motion(zoo.five_bar)
    rom = model(zoo.five_bar, "minimal", 2)
    corrected = rj.corrected(rom, zoo.run(rom, motion.t))
    assert "(the full model)" in corrected.summary()
    assert corrected.bar.error < 1e-6
    given = rj.corrected(rom, zoo.run(rom, motion.t), by=rom.full)
    assert "(the full model)" in given.summary()
    with pytest.raises(
        rj.InputError, match="by has 2 freedoms, and the model that it is to judge 2"
    ):
        rj.corrected(rom, corrected, by=rom)
    with pytest.raises(rj.InputError, match="by is of type int; give a model of the same"):
        rj.corrected(rom, corrected, by=3)
    with pytest.raises(rj.InputError, match="there is no estimate 'richer'"):
        rj.corrected(rom, corrected, by="richer")
    with pytest.raises(rj.InputError, match="by has the coordinates bar1.x, bar1.y, bar1.phi, but"):
        rj.corrected(rom, corrected, by=zoo.system(zoo.bar))


@pytest.mark.slow
def test_a_corrected_run_within_transformations():
    """The derivative of the error by a mass, against a difference of it."""
    rom = model(zoo.bars, "minimal", 1)
    ts = np.linspace(0.0, 0.5, 26)

    def error(mass):
        full = rj.assemble(zoo.bars(masses=(1.0, mass)))
        own = rom.with_full(full).starting_at(full.q0, full.v0)
        run = zoo.run(own, ts, throw=False)
        return rj.compare(rj.corrected(own, run), run).error

    step = 1e-4
    slope = jax.jit(jax.grad(error))(1.1)
    difference = (error(1.1 + step) - error(1.1 - step)) / (2 * step)
    assert abs(slope - difference) <= 1e-3 * abs(difference)
    assert np.allclose(jax.jit(jax.vmap(error))(np.array([1.0, 1.1]))[1], error(1.1), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("spin", "least", "most"), [(0.02, 0.9, 1.1), (0.15, 0.9, 1.2)])
def test_the_error_by_the_residual(spin, least, most):
    """From other starts; about accelerations of the full system it would grow without bound."""
    rom = model(zoo.falling_beams, "minimal", 2)
    system = spun(rom.full, spin)
    own = rom.with_full(system).starting_at(system.q0, system.v0)
    ts = np.linspace(0.0, 1.0, 101)
    truth = zoo.run(system, ts, solver=zoo.RODAS5P)
    run = zoo.run(own, ts, rtol=1e-6)
    corrected = rj.corrected(own, run, by="residual")
    error = float(rj.compare(truth, run).error)
    assert least <= float(rj.compare(corrected, run).error) / error <= most, error
    assert np.max(corrected.violation) <= 1e-8
    assert "(linear)" in corrected.summary()
    assert corrected.system.n == system.n


@pytest.mark.slow
def test_no_linear_estimate_in_space():
    motion = zoo.motion(zoo.beam_in_space)
    rom = rj.reduce(motion.system, rj.pod(motion, rank=1), "local")
    run = zoo.run(rom, motion.t)
    with pytest.raises(rj.InputError, match="moves in space, of which no linear estimate"):
        rj.corrected(rom, run, by="residual")


def test_what_cannot_be_corrected():
    motion = zoo.motion(zoo.five_bar)
    with pytest.raises(rj.InputError, match="is a full one, which leaves nothing out"):
        rj.corrected(motion.system, motion)
    two = jax.tree.map(lambda x: jnp.stack([x, x]), motion)
    with pytest.raises(rj.InputError, match="the run is a batch"):
        rj.corrected(motion.system, two)
    with pytest.raises(rj.InputError, match="give the model that was simulated"):
        rj.corrected(zoo.system(zoo.bar), motion)
