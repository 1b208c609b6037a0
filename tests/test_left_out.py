"""What the modes of a reduced model leave out of its own training: every run of it tells."""

import dataclasses
import gc
import weakref

import diffrax
import jax
import numpy as np
import pytest
import zoo
from groups import in_groups
from numpy.testing import assert_allclose

import romjax as rj
from romjax.basis.snapshots import SnapshotSet
from romjax.integrate import left_out, training_error
from romjax.integrate.training_error import TrainingError
from romjax.reduction.formulation.parse import as_formulation
from romjax.system.structure import Structure
from romjax.system.training import training_of

LEFT_OUT = rj.Flag.LEFT_OUT
# The tolerance at which models are measured whose training is more accurate.
MEASURED = 1e-8


def settings(make):
    return {"solver": zoo.RODAS5P if make is zoo.falling_beams else zoo.DOPRI8, "rtol": 1e-6}


def bending_crank():
    """A slider crank whose rod bends."""
    return zoo.slider_crank(bends=True)


def model(make, formulation, rank, **numbers):
    """A motion, and the model of so many modes that is made of it."""
    motion = zoo.motion(make, **numbers)
    chosen = as_formulation(formulation)
    basis = chosen.basis(motion.system, motion, rj.POD(rank))
    return motion, rj.reduce(motion.system, basis, chosen)


def off(motion, run):
    """How far off a body is at most, over the longest way of one."""
    places = np.ravel(motion.system.full.structure.positions)
    q, other = np.asarray(motion.q)[:, places], np.asarray(run.q)[:, places]
    return np.max(np.abs(q - other)) / np.max(np.abs(q - q[0]))


@pytest.fixture(scope="module")
def halved():
    """A five-bar with one of its two freedoms."""
    return model(zoo.five_bar, "minimal", 1)


@pytest.mark.slow
def test_a_model_of_few_modes_tells_how_much_it_errs(halved):
    """Without a Python warning: it was asked for."""
    motion, rom = halved
    run = zoo.run(rom, motion.t, **settings(zoo.five_bar))
    assert run.flags & LEFT_OUT
    error = off(motion, run)
    assert error > 1e-3
    limits = "more than 100 rtol, and 1e-4, or by a tenth of how one body moves or bends"
    words = f"{limits}, on the motions that it was made of ({error:.1e} of"
    assert words in run.warnings()
    (measured,) = training_of(rom).errors
    assert_allclose(measured.after(measured.elapsed[-1]), error, rtol=1e-3)


def test_other_numbers_starts_and_shorter_runs_are_measured_by_the_same(halved, monkeypatch):
    motion, rom = halved
    zoo.run(rom, motion.t, **settings(zoo.five_bar))
    monkeypatch.setattr(left_out, "_measure", None)
    others = [
        rom.with_full(zoo.system(zoo.five_bar, mass=1.05)),
        rom.starting_at(motion.q[20], motion.v[20], motion.t[20]),
    ]
    for other in others:
        assert zoo.run(other, motion.t[20:], **settings(zoo.five_bar)).flags & LEFT_OUT
    # Tolerances that promise no more than the model does are kept.
    loose = settings(zoo.five_bar) | {"rtol": 0.1}
    assert not zoo.run(rom, motion.t, **loose).flags & LEFT_OUT


def test_models_of_all_freedoms_are_not_told_of():
    motion, rom = model(zoo.five_bar, "minimal", 2)
    run = zoo.run(rom, motion.t, **settings(zoo.five_bar))
    assert run.is_valid, run.warnings()
    (measured,) = training_of(rom).errors
    assert measured.error[-1] <= 100 * MEASURED


def with_errors(rom, motion, error, **numbers):
    """Pretend that a model errs so much on its training."""
    training = training_of(rom)
    known = training_error._numbers(rom)
    start = motion.t[0], motion.q[0], motion.v[0]
    elapsed = np.asarray(motion.t - motion.t[0])
    errors = np.full(len(elapsed), error)
    training.errors = (TrainingError(elapsed, errors, MEASURED, known, start),)


def test_other_motions_by_models_that_err_on_their_own_are_told_of():
    """Other numbers, another start, a longer run; neither the training nor a part of it."""
    motion, rom = model(zoo.five_bar, "minimal", 2)
    with_errors(rom, motion, 5e-5)

    def told(own, ts):
        return zoo.run(own, ts, **settings(zoo.five_bar)).flags & rj.Flag.UNTRIED

    again = rom.with_full(rj.assemble(zoo.five_bar()))
    heavier = rom.with_full(zoo.system(zoo.five_bar, mass=1.05))
    later = rom.starting_at(motion.q[20], motion.v[20], motion.t[20])
    assert [bool(told(x, motion.t)) for x in (rom, again, heavier)] == [False, False, True]
    assert told(later, motion.t[20:])
    assert not told(rom, motion.t[:50])
    assert told(rom, np.linspace(0.0, 1.1 * float(motion.t[-1]), 11))
    run = zoo.run(heavier, motion.t, **settings(zoo.five_bar))
    assert "romjax.corrected tells its error" in run.warnings()
    with_errors(rom, motion, 2e-5)  # below 30 rtol
    assert not told(heavier, motion.t)


@pytest.mark.slow
def test_other_motions_are_told_of_within_transformations():
    motion, rom = model(zoo.five_bar, "minimal", 2)
    with_errors(rom, motion, 5e-5)

    def lane(mass):
        other = rom.with_full(rj.assemble(zoo.five_bar(mass=mass)))
        return {"flags": zoo.run(other, motion.t, **settings(zoo.five_bar), throw=False).flags}

    flags = rj.sweep(lane, np.array([1.0, 1.05])).flags
    assert flags.tolist() == [0, int(rj.Flag.UNTRIED)]


# One of each kind, of which two are told of: by the way of a body, or by how it bends.
FEW = [
    (zoo.cart_pendulum, "galerkin", 3, True),
    (zoo.cart_pendulum, "local", 2, False),
    (zoo.four_bar, "table", 1, False),
    (zoo.bars, "hyper", 1, True),
]
ASKED = [
    *FEW,
    (zoo.cart_pendulum, "minimal", 2, True),
    (bending_crank, "minimal", 2, True),
    (bending_crank, "minimal", 3, False),
    (zoo.falling_beams, "minimal", 5, True),
    (zoo.falling_beams, "local", 4, True),  # a deflection, by 11 %
    (zoo.falling_beams, "local", 6, False),
    (zoo.four_bar, "minimal", 1, False),
    (zoo.bars, "minimal", 1, True),
    (zoo.bars, "hyper", 2, False),
]


@pytest.mark.parametrize(("make", "formulation", "rank", "told"), in_groups(ASKED, slow=FEW))
def test_who_errs_on_its_training_is_told_of(make, formulation, rank, told):
    """Of every kind, with nothing set, and nobody else."""
    motion, rom = model(make, formulation, rank)
    run = rj.simulate(rom, motion.t)
    error, hidden = off(motion, run), rj.compare(motion, run).hidden()
    assert (error > 1e-4 or hidden != "") == told, f"error {error:.1e}, {hidden}"
    assert bool(run.flags & LEFT_OUT) == told, f"error {error:.1e}, {hidden}"


@pytest.mark.slow
def test_runs_within_transformations_tell(halved):
    """Of a model that nobody has measured before JAX traces it."""
    motion, _ = halved
    _, rom = model(zoo.five_bar, "minimal", 1)

    def lane(mass):
        other = rom.with_full(rj.assemble(zoo.five_bar(mass=mass)))
        return zoo.run(other, motion.t, **settings(zoo.five_bar), throw=False)

    masses = np.array([1.0, 1.05])
    assert np.all(rj.sweep(lambda m: {"flags": lane(m).flags}, masses).flags & LEFT_OUT)
    assert jax.jit(lane)(1.0).flags & LEFT_OUT
    (measured,) = training_of(rom).errors
    # Also the span may be traced.
    short = jax.jit(measured.after)(0.2)
    assert_allclose(short, measured.after(np.asarray(0.2)))


@pytest.mark.slow
def test_methods_without_estimates_of_errors_are_measured_by_another(halved):
    motion, _ = halved
    _, rom = model(zoo.five_bar, "minimal", 1)
    run = rj.simulate(rom, motion.t, solver=diffrax.Euler(), dt=1e-3)
    assert run.flags & LEFT_OUT


@pytest.mark.slow
def test_of_several_motions_the_worst_counts():
    """Each is repeated by its own system, also those in which something is looked for."""
    first, second = (zoo.motion(zoo.five_bar, spring=spring) for spring in (60.0, 90.0))
    stop = rj.Crossing(_height)
    third = zoo.run(first.system, first.t, events=[stop])
    rom = rj.reduce(first.system, rj.pod([first, second, third], rank=6))
    run = zoo.run(rom, first.t, **settings(zoo.five_bar))
    errors = training_of(rom).errors
    other = rom.with_full(second.system).starting_at(second.q[0], second.v[0])
    own = [off(first, run), off(second, zoo.run(other, second.t, **settings(zoo.five_bar)))]
    own.append(own[0])
    assert_allclose([one.error[-1] for one in errors], own, rtol=1e-2)


def test_what_the_error_of_positions_hides_is_told_of():
    """A deflection that is small beside the motion, and wrong. A loose tolerance resolves none."""
    motion, rom = model(zoo.cart_pendulum, "local", 2)
    q, start = np.asarray(motion.q), np.asarray(motion.q[0])
    bends = np.array([label.startswith("pendulum.q") for label in motion.labels])
    small, large = (start + np.where(bends, size, 1.0) * (q - start) for size in (1e-2, 1.3e-2))
    truth, wrong = (dataclasses.replace(motion, q=x) for x in (small, large))
    structure, resolved = motion.system.full.structure, training_error.resolution(truth, wrong)
    assert training_error._hidden(structure, truth, small, resolved) == ("", 0.0)
    hidden, missed = training_error._hidden(structure, truth, large, resolved)
    assert hidden == "deflection of pendulum is wrong by 30 %"
    assert missed <= rj.compare(truth, wrong).error

    with_errors(rom, motion, 1e-6)
    (silent,) = training_of(rom).errors

    def again(rtol=1e-6, **start):
        return zoo.run(rom, motion.t, solver=zoo.RODAS5P, rtol=rtol, throw=False, **start)

    assert again().is_valid
    training_of(rom).errors = (silent._replace(hidden=hidden, missed=missed),)
    run = again()
    assert run.flags == LEFT_OUT
    assert f"of the longest way of a body, and {hidden}; take more modes" in run.warnings()
    assert not again(0.1 * missed).flags & LEFT_OUT
    assert jax.jit(lambda q: again(q0=q).flags)(rom.q0) == LEFT_OUT


def _height(system, t, q, v):
    del system, t, v
    return q[1] - 10.0


def test_what_is_not_known_is_not_measured(halved):
    """Given modes, motions without their system, and models whose error somebody estimates."""
    motion, _ = halved
    given = rj.Basis.from_modes(np.eye(12), motion.q[0])
    assert training_of(rj.reduce(motion.system, given, "minimal")) is None
    assert training_of(motion.system) is None
    assert not left_out._is_known(SnapshotSet.of(motion))


def test_what_is_remembered_is_forgotten_with_the_model(only_new_garbage):
    """The motions after they were repeated, the rest with the model."""
    motion, rom = model(zoo.five_bar, "minimal", 2)
    training = training_of(rom)
    assert training.motions == (motion,)
    zoo.run(rom, motion.t, **settings(zoo.five_bar))
    assert training.motions == ()
    alive = weakref.ref(training)
    del rom, training
    gc.collect()
    assert alive() is None


@pytest.mark.instant
def test_the_error_up_to_a_time():
    """Of a longer motion that of the end; times may be off by rounding."""
    error = TrainingError(np.array([0.0, 0.1, 0.2]), np.array([0.0, 1.0, 3.0]), 1e-6)
    spans = {0.05: 0.0, 0.1: 1.0, 0.1 - 1e-14: 1.0, 0.15: 1.0, 0.2: 3.0, 7.0: 3.0}
    assert {span: error.after(np.asarray(span)) for span in spans} == spans


@pytest.mark.instant
def test_the_error_is_that_of_positions():
    """Over the longest way of any; of angles only where no body moves. Rest has none."""
    structure, q = zoo.system(zoo.four_bar).structure, np.zeros((3, 9))
    q[1:, 0], q[1:, 2] = (1.0, 2.0), (50.0, 90.0)
    other = q.copy()
    other[1:, 1], other[1:, 2] = (0.1, -0.1), 0.0
    assert_allclose(training_error._history(structure, q, other), [0.0, 0.1, 0.05])
    q[:, 0] = other[:, 0] = 7.0
    assert_allclose(training_error._history(structure, q, other), [0.0, 1.0, 1.0])
    assert_allclose(training_error._history(structure, q[:1], other[:1]), [0.0])
    # Rounding of a mechanism at rest is none, and a model that moves errs by what it moves.
    rest, noise = np.ones((3, 9)), np.zeros((3, 9))
    noise[1:] = 1e-15
    assert_allclose(training_error._history(structure, rest + noise, rest), 0.0, atol=1e-14)
    assert_allclose(training_error._history(structure, rest, rest + 1e15 * noise), [0.0, 0.5, 0.5])


@pytest.mark.instant
def test_quaternions_of_any_length_and_sign_are_turns():
    structure = dataclasses.replace(Structure.unnamed(7, 0), frames=(0,), quaternions=(3,))
    q = np.zeros((2, 7))
    q[:, 3:5] = [[1.0, 0.0], [0.6, 0.8]]
    assert_allclose(training_error._history(structure, q, -2 * q), [0.0, 0.0], atol=1e-15)
