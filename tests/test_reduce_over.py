"""One reduced model for a box of parameters."""

import dataclasses

import numpy as np
import pytest
from tolerances import SOLVED

import romjax as rj
from romjax.study.boxes.reduced_box import covering

TS = np.linspace(0.0, 0.3, 31)
TOL = 1e-3
# Required on held-out points: estimates between half and twice the error.
EFFECTIVITY = 2.0
# The same of the linear flow along a training run.
FLOW = 2.5
# The chapter's example over the amplitude and frequency of its force, and its first mode.
CHAPTER = {"force": (5.0, 15.0), "frequency": (8.0, 12.0), "f1": (14.0, 18.0)}


def beams(mass: float = 1.0, f1: float = 20.0) -> rj.Scene:
    """Two hinged beams that fall from the level, of which the second one varies."""
    bodies = [
        rj.Beam("a", 1.0, 1.0, frequencies=[20.0, 60.0], position=(0.5, 0.0)),
        rj.Beam("b", mass, 1.0, frequencies=[f1, 60.0], position=(1.5, 0.0)),
    ]
    first = rj.Revolute(bodies[0].at((-0.5, 0.0)), rj.ground.at())
    second = rj.Revolute(bodies[1].at((-0.5, 0.0)), bodies[0].at((0.5, 0.0)))
    return rj.Scene(bodies, [first, second], [rj.Gravity()])


@pytest.fixture(scope="module")
def box():
    return rj.Box(beams, mass=(0.5, 2.0), f1=rj.Range(15.0, 30.0, log=True))


@pytest.fixture(scope="module")
def reduced(box):
    return rj.reduce_over(box, TS, TOL, candidates=8, held_out=4, flow=True)


@pytest.mark.instant
def test_points_fill_the_box(box):
    points = box.sample(64)
    assert repr(box) == "Box(mass: 0.5 to 2, f1: 15 to 30)"
    assert np.min(points["mass"]) >= 0.5
    assert np.max(points["mass"]) <= 2.0
    assert abs(np.mean(points["mass"]) - 1.25) < 0.05
    assert sorted(zip(*box.corners().values(), strict=True))[1:3] == [(0.5, 30.0), (2.0, 15.0)]
    # Evenly in the logarithm.
    assert abs(np.mean(np.log(points["f1"])) - np.log(box.center["f1"])) < 0.05
    assert abs(box.center["f1"] - np.sqrt(15.0 * 30.0)) < SOLVED


@pytest.mark.slow
def test_the_error_is_kept_in_the_box(box, reduced):
    """At a point that was neither trained nor held out."""
    point = {"mass": 1.9, "f1": 16.0}
    truth = rj.simulate(box.system(**point), TS, rtol=1e-8, audit=False)
    run = rj.simulate(reduced.at(**point), TS, rtol=1e-7)
    assert rj.compare(truth, run).error <= TOL
    assert run.is_valid
    assert reduced.rom.n < 6
    assert reduced.error <= TOL
    assert reduced.rom.validity.error == reduced.error


@pytest.mark.slow
def test_what_the_model_says_of_itself(reduced):
    assert len(reduced.errors) >= 3
    assert abs(reduced.share ** len(reduced.errors) - 0.05) < SOLVED
    assert "training run" in reduced.summary()
    assert "of the box with a confidence of 95%" in reduced.summary()
    assert set(reduced.training) == {"mass", "f1"}
    factor, covered = reduced.factor
    assert 0 < factor < EFFECTIVITY
    assert abs(covered - len(reduced.errors) / (len(reduced.errors) + 1)) < SOLVED
    assert "times the estimate in" in reduced.summary()


@pytest.mark.instant
def test_what_a_factor_on_estimates_covers():
    """Of 200 boxes, each with its own held-out runs and unseen ones; few runs promise less."""
    lot = np.random.default_rng(4)
    for count, share in ((19, 0.95), (59, 0.95), (9, 0.9)):
        covered = []
        for _ in range(200):
            errors = lot.lognormal(0.0, 1.0, (count + 40))
            estimates = errors * lot.lognormal(0.0, 0.2, count + 40)
            factor, promised = covering(errors[:count], estimates[:count])
            assert share - SOLVED <= promised <= share + 0.02
            covered.append(np.mean(errors[count:] <= factor * estimates[count:]))
        assert abs(np.mean(covered) - promised) < 0.02
    assert covering(np.zeros(0), np.zeros(0)) == (np.inf, 0.0)


@pytest.mark.slow
def test_a_sweep_falls_back_on_the_full_model(box, reduced):
    """Outside of the box, and where the estimate is too large for what is asked."""
    best, worst = (int(pick(reduced.estimates)) for pick in (np.argmin, np.argmax))
    points = {name: x[[best, worst, worst]] for name, x in reduced.candidates.items()}
    points["mass"][2] = 2 * box.ranges["mass"].high
    between = np.sqrt(reduced.estimates[best] * reduced.estimates[worst])
    strict = dataclasses.replace(reduced, tol=float(2 * between), flows=None)
    swept = rj.sweep_over(strict, points, TS, lambda run: run.q[-1])
    assert swept.by_full.tolist() == [False, True, True]
    assert 0 < swept.estimates[0] < between
    assert not np.any(swept.estimates[1:])
    assert np.all(swept.success)
    for number, mass in enumerate(points["mass"]):
        system = rj.assemble(beams(mass, points["f1"][number]))
        truth = rj.simulate(system, TS, rtol=1e-9, audit=False)
        error = np.linalg.norm(swept.values[number] - truth.q[-1])
        assert error <= strict.tol * np.linalg.norm(truth.q[-1] - truth.q[0])
    with pytest.raises(rj.InputError, match="no parameter 'weight'; those are mass, f1"):
        rj.sweep_over(reduced, {"weight": np.ones(1)}, TS, len)
    with pytest.raises(rj.InputError, match=r"shapes \(\); give each as an array"):
        rj.sweep_over(reduced, {"mass": 1.0}, TS, len)


@pytest.mark.slow
def test_the_flow_of_a_box_tells_errors(reduced):
    """Of held-out mechanisms, by no second run: in size here, and in a sweep the same."""
    points, told = reduced.held_out, []
    for i, error in enumerate(reduced.errors):
        run = rj.simulate(reduced.at(**{name: x[i] for name, x in points.items()}), TS, rtol=1e-7)
        corrected = reduced.corrected(run)
        told.append(float(corrected.bar.error))
        assert error / FLOW <= told[-1] <= error * FLOW
        assert "estimated (flow along a training run)" in corrected.summary()
        assert float(rj.compare(corrected, run).error) == pytest.approx(told[-1], rel=1e-2)
    swept = rj.sweep_over(reduced, points, TS, lambda run: run.q[-1])
    assert not np.any(swept.by_full)
    assert np.allclose(swept.estimates, told, rtol=0.1)
    late = rj.simulate(reduced.at(), TS[:-1], audit=False)
    with pytest.raises(rj.InputError, match="30 output times that are not those of the training"):
        reduced.corrected(late)
    rom = rj.reduce(reduced.rom.full, rj.pod(late, rank=2))
    other = rj.simulate(rom, TS, audit=False, throw=False)
    with pytest.raises(rj.InputError, match="the run is one of 2 coordinates"):
        reduced.corrected(other)


@pytest.mark.slow
def test_processes_share_the_runs_that_are_held_out(box, reduced, tmp_path):
    """What is in the folder is taken as it is, unless it is of other times."""
    settings = {"candidates": 8, "held_out": 4, "path": tmp_path, "chunk": 2}
    made = rj.reduce_over(box, TS, TOL, **settings)
    assert np.allclose(made.errors, reduced.errors, rtol=1e-3)
    chunks = sorted(tmp_path.glob("chunk-*.npz"))
    assert len(chunks) == 2
    before = [file.stat().st_mtime_ns for file in chunks]
    chunks[0].unlink()
    again = rj.reduce_over(box, TS, TOL, **settings)
    assert np.array_equal(again.errors, made.errors)
    assert [file.stat().st_mtime_ns > at for file, at in zip(chunks, before, strict=True)] == [1, 0]
    with pytest.raises(ValueError, match="holds another sweep, which differs in its parameters"):
        rj.reduce_over(box, TS * 0.9, TOL, **settings)


@pytest.mark.exhaustive
def test_full_runs_of_a_sweep_join_the_training(reduced):
    """Fewer lanes are left to the full model, and the others are as good as its own."""
    strict = dataclasses.replace(reduced, tol=float(np.median(reduced.estimates)), flows=None)
    plain, learned = (
        rj.sweep_over(strict, reduced.candidates, TS, lambda run: run.q, learn=most)
        for most in (0, 2)
    )
    assert len(learned.reduced.training["mass"]) > len(reduced.training["mass"])
    assert len(reduced.greedy.trained) == len(reduced.training["mass"])
    assert np.sum(learned.by_full) < np.sum(plain.by_full)
    for wanted, own in zip(plain.values[plain.by_full], learned.values[plain.by_full], strict=True):
        assert np.linalg.norm(own - wanted) <= strict.tol * np.linalg.norm(wanted - wanted[:1])


@pytest.mark.slow
def test_runs_that_do_not_suffice_are_refused(box):
    with pytest.raises(rj.ReductionError, match=r"1 training runs reach an error of .*, not tol"):
        rj.reduce_over(box, TS, TOL, runs=1, candidates=8, held_out=0)


@pytest.mark.instant
def test_bad_boxes():
    with pytest.raises(rj.InputError, match="no parameter has a range"):
        rj.Box(beams)
    with pytest.raises(rj.InputError, match=r"mass=\(1.0,\); give it as \(low, high\)"):
        rj.Box(beams, mass=(1.0,))
    with pytest.raises(rj.InputError, match="give two numbers that ascend"):
        rj.Box(beams, mass=(2.0, 1.0))
    with pytest.raises(rj.InputError, match="low=-1.0 has no logarithm"):
        rj.Range(-1.0, 1.0, log=True)
    box = rj.Box(beams, mass=(0.5, 2.0))
    with pytest.raises(rj.InputError, match="no parameter 'weight'; those are mass"):
        box.system(weight=1.0)
    with pytest.raises(rj.InputError, match="mass=3.0 lies outside of 0.5 to 2; make a larger box"):
        box.system(mass=3.0)
    with pytest.raises(rj.InputError, match="tol=2.0, but it must lie between 0 and 1"):
        rj.reduce_over(box, TS, 2.0)
    with pytest.raises(rj.InputError, match="runs=0, candidates=64, held_out=16; take at least"):
        rj.reduce_over(box, TS, 1e-2, runs=0)


@pytest.mark.exhaustive
@pytest.mark.usefixtures("with_optimisation")
@pytest.mark.parametrize(("tol", "points"), [(1e-3, 64), (1e-4, 64), (1e-5, 64), (1e-4, 16)])
def test_the_chapters_example_over_a_box(tol, points):
    """With at most four training runs, chosen and held out among many points."""
    ts = np.linspace(0.0, 1.0, 101)
    box = rj.Box(rj.gallery.cart_pendulum, **CHAPTER)
    reduced = rj.reduce_over(box, ts, tol, runs=4, candidates=points, held_out=points)
    assert len(reduced.errors) >= 0.95 * points
    assert np.max(reduced.errors) <= tol
    # Of the largest ones, at different points.
    effectivity = np.max(reduced.estimates) / np.max(reduced.errors)
    assert 1 / EFFECTIVITY <= effectivity <= EFFECTIVITY
