"""Accuracy asked, rank delivered; and what speaks against a result."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from groups import in_groups

import romjax as rj
from romjax.system.base import Run
from romjax.system.validity import TrainingBox

# Required on variations of the scene: errors up to so many times what was asked, or a flag.
HELD_OUT = 3
VARIATIONS = (
    {"force": 200.0},
    {"force": 11.0, "f1": 17.0},
    {"frequency": 9.5, "stiffness": 130.0},
)
ASKED = [(kind, tol) for kind in ("galerkin", "minimal") for tol in (1e-2, 1e-4, 1e-6)]


def varied(**numbers) -> rj.AbstractSystem:
    return rj.assemble(rj.gallery.cart_pendulum(**numbers))


def moved(system, **settings) -> rj.Trajectory:
    """For four periods of the load, with the method that the default is for this mechanism."""
    ts = np.linspace(0.0, 0.4, 81)
    return zoo.run(system, ts, solver=zoo.RODAS5P, rtol=1e-9, **settings)


@pytest.fixture(scope="module")
def truth(cart_pendulum):
    return moved(cart_pendulum)


@pytest.fixture(scope="module")
def others():
    return [(system, moved(system)) for system in (varied(**numbers) for numbers in VARIATIONS)]


class Elsewhere(rj.AbstractFormulation):
    """One of which no more is known."""

    name = "elsewhere"

    def reduce(self, system, basis):
        raise NotImplementedError


@pytest.mark.instant
def test_what_a_basis_may_miss():
    """Nothing follows from it unless the formulation says so."""
    kinds = rj.Galerkin(), rj.Minimal(), rj.Local(), Elsewhere()
    assert [kind.most_missed for kind in kinds] == [0.2, 2.0, np.inf, np.inf]


SLOW = [("galerkin", 1e-6)]


@pytest.mark.parametrize(("formulation", "tol"), in_groups(ASKED, slow=SLOW))
def test_the_error_asked_for_is_kept(truth, cart_pendulum, others, formulation, tol):
    """On the training, and on variations or with a flag; the force twenty times as large is
    flagged in any case. The estimate is no smaller than the error.
    """
    rom = rj.reduce_to(cart_pendulum, truth, tol, formulation=formulation)
    settings = {"rtol": min(1e-4 * tol, 1e-7), "throw": False}  # well below the error of the model
    approx = rj.simulate(rom, truth.t, **settings)
    report = rj.compare(truth, approx)
    error = report.error
    assert error <= tol
    assert error <= 2 * rom.validity.error
    assert bool(approx.flags & rj.Flag.LEFT_OUT) == bool(report.hidden())
    assert f"for tol {tol:g}" in rom.summary
    for number, (system, run) in enumerate(others):
        approx = rj.simulate(rom.with_full(system), truth.t, **settings)
        flagged = approx.flags != rj.Flag.NONE  # a run that failed is no flagged one
        assert flagged or rj.compare(run, approx).error <= HELD_OUT * tol
        assert flagged or number > 0


@pytest.mark.slow
def test_what_the_norm_hides_is_told_of(truth, cart_pendulum):
    """One coordinate holds the motion of the cart, beside which the pendulum bends little."""
    rom = rj.reduce_to(cart_pendulum, truth, 3e-2, formulation="minimal")
    approx = rj.simulate(rom, truth.t, rtol=1e-7)
    report = rj.compare(truth, approx)
    assert report.error <= 3e-2
    assert report.hidden() == "deflection of pendulum is wrong by 100 %"
    assert approx.flags & rj.Flag.LEFT_OUT
    assert all(report.hidden() in words for words in (approx.warnings(), rom.summary))


@pytest.mark.slow
def test_variations_join_the_training(truth, cart_pendulum):
    """The last one is tried; it fails a model of the training alone, and joins."""
    more, tol = [varied(force=11.0), varied(f2=100.0)], 1e-5
    rom = rj.reduce_to(cart_pendulum, truth, tol, variations=more, formulation="minimal")
    assert "2 training runs" in rom.summary
    for system, run in ((cart_pendulum, truth), (more[1], moved(more[1]))):
        approx = rj.simulate(rom.with_full(system), truth.t, rtol=1e-8)
        assert rj.compare(run, approx).error <= tol
        assert approx.is_valid


@pytest.mark.slow
def test_a_run_beyond_the_training_is_doubted(truth, cart_pendulum):
    """And one within is not."""
    basis = rj.pod(truth, rank=5)
    motion = rj.simulate(rj.reduce(cart_pendulum, basis), truth.t)
    assert motion.is_valid
    assert not motion.warnings()
    motion = rj.simulate(rj.reduce(varied(force=200.0), basis), truth.t)
    leaves, departs = motion.each_warning()
    assert "leaves the box" in leaves
    assert "out of its model" in departs
    assert motion.flags == rj.Flag.OUTSIDE_TRAINING | rj.Flag.UNMODELLED


def test_a_subspace_that_leaves_the_constraints_is_doubted():
    """At five tolerances of the steps; stabilization leaves two."""
    rest, times = np.zeros((2, 1)), np.array([0.0, 1.0])
    box, drift = TrainingBox.of(jnp.asarray(rest), 1e-12), np.full(2, 1e-3)
    for share, flag in ((2.1, 0), (5.0, rj.Flag.VIOLATION)):
        assert box.flags(None, Run(times, rest, rest, rest, share * drift, drift)) == flag


@pytest.mark.slow
def test_energy_from_nowhere_is_doubted(falling):
    """The chapter's projection of the solution, with weak stabilisation."""
    system, training = falling
    rom = rj.reduce(system, rj.pod(training, rank=2), rj.Projected(rj.Baumgarte(5.0, 10.0)))
    with pytest.warns(UserWarning, match="its energy changes by more than the work of the forces"):
        motion = zoo.run(rom, training.t, audit=True)
    assert rj.Flag.ENERGY in rj.Flag(int(motion.flags))


@pytest.mark.slow
def test_a_start_away_from_the_origin():
    """The cart 0.3 m along its rail, the pendulum at 1 rad: errors as at the chapter's start."""
    errors = []
    for place, angle in ((0.0, 0.0), (0.3 / np.sqrt(2), 1.0)):
        system = varied()
        q0 = np.array(system.q0)
        q0[:2], q0[5] = place, angle
        q0[3:5] = place + 0.4 * np.array([np.sin(angle), -np.cos(angle)])
        motion = moved(system, q0=q0)
        rom = rj.reduce(system, rj.pod(motion, rank=5))
        errors.append(rj.compare(motion, rj.simulate(rom, motion.t, rtol=1e-9, audit=False)).error)
    assert errors[1] <= 10 * errors[0]


@pytest.fixture(scope="module")
def falling():
    """Two bars that fall: the system and a run."""
    run = zoo.motion(zoo.bars)
    return run.system, run


@pytest.mark.slow
def test_what_cannot_be_reached_is_refused(falling):
    """A run that is no motion of the mechanism has no model as good as that."""
    system, run = falling
    other = dataclasses.replace(run, t=1.01 * run.t)
    with pytest.raises(rj.ReductionError, match="no rank up to 6 reaches tol=1e-07"):
        rj.reduce_to(system, other, 1e-7, formulation="minimal")
    with pytest.raises(ValueError, match="tol=2.0, but it must lie between 0 and 1"):
        rj.reduce_to(system, run, 2.0)


def test_programming_errors_surface(falling, monkeypatch):
    """They were told as "no rank reaches tol"."""

    def wrong(*arguments, **settings):
        raise ValueError("a bug")

    monkeypatch.setattr("romjax.study.ranks.rank_search.reduce", wrong)
    with pytest.raises(ValueError, match="^a bug$"):
        rj.reduce_to(*falling, 0.5)


@pytest.mark.slow
def test_a_model_that_cannot_start_is_no_model(falling, monkeypatch):
    """Of a held-out variation the reduced constraints cannot hold: that joins the training."""
    system, training = falling
    accepted = []

    def refused(rom, q, v, t):
        accepted.append(t)
        raise rj.ReductionError("The reduced model has no start there.")

    monkeypatch.setattr(rj.ReducedSystem, "starting_at", refused)
    with pytest.raises(rj.ReductionError, match="no rank up to 6 reaches tol=0.01; The reduced"):
        rj.reduce_to(system, training, 1e-2)
    # Up to four modes miss so much of the snapshots that they are not tried.
    assert len(accepted) == 2


@pytest.mark.exhaustive
def test_variations_are_simulated_as_the_training_was(falling, monkeypatch, tmp_path):
    """By the same method, not by the default one."""
    system, _ = falling
    # What is read from a folder is not traced.
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path))
    training = moved(system)
    solvers = []

    def watched(system, ts, *, solver=None, **settings):
        solvers.append(solver)
        return rj.simulate(system, ts, solver=solver, **settings)

    monkeypatch.setattr("romjax.study.sweeps.batch.simulate", watched)
    rj.reduce_to(system, training, 1e-2, variations=[system], formulation="minimal")
    assert type(solvers[0]) is rj.Rodas5P


def test_a_formulation_for_reference_is_refused(falling):
    with pytest.raises(rj.ReductionError, match="'projected' is for reference only"):
        rj.reduce_to(*falling, 1e-2, formulation="projected")
    with pytest.raises(rj.ReductionError, match="formulation='best'"):
        rj.reduce_to(*falling, 1e-2, formulation="best")
