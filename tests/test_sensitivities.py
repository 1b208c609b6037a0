"""Derivatives by the parameters of a box: as snapshots, and in a search for parameters."""

from typing import NamedTuple

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from jax import Array
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import run

import romjax as rj
from romjax.study.boxes.full_runs import FullRuns


class Motion(NamedTuple):
    """What a basis asks of a motion."""

    t: Array
    q: Array
    v: Array
    metric: Array
    labels: tuple[str, ...] = ()


TS = np.linspace(0.0, 0.3, 31)
TRUE = {"mass": 1.37, "f1": 19.0}
SOLVER = diffrax.Dopri8()
SIZES = np.array([1.0, 0.01, 0.01])


def hanging(mass: float = 1.0, f1: float = 20.0) -> rj.Scene:
    """A beam on a hinge, pulled by a spring."""
    beam = rj.Beam("beam", mass, 1.0, frequencies=[f1, 60.0], position=(0.5, 0.0))
    hinge = rj.Revolute(beam.at((-0.5, 0.0)), rj.ground.at())
    spring = rj.Spring(beam.at((0.5, 0.0)), rj.ground.at((1.0, 1.0)), 30.0)
    return rj.Scene([beam], [hinge], [rj.Gravity(), spring])


def angle_and_amplitudes(motion):
    return motion.q[:, 2:5] / SIZES[None]


@pytest.fixture(scope="module")
def box():
    return rj.Box(hanging, mass=(0.5, 2.0), f1=rj.Range(12.0, 30.0, log=True))


@pytest.fixture(scope="module")
def truth(box):
    return rj.simulate(box.system(**TRUE), TS, rtol=1e-10, solver=SOLVER)


def test_a_snapshot_beside_those_of_motions():
    """The subspace also holds what the motion never does; the motion itself stays."""
    t, metric = np.linspace(0.0, 1.0, 11), np.diag([1.0, 2.0, 4.0])
    along = np.stack([t, 0.1 * t**2, 0 * t], axis=1)
    motion = Motion(*map(jnp.asarray, (t, along, np.gradient(along, axis=0), metric)))
    across = jnp.asarray(np.stack([0 * t, 0 * t, t], axis=1))
    change = rj.Sensitivity(motion.t, across, 0 * across)
    alone, beside = rj.pod(motion, rank=1), rj.pod([motion, change], rank=2)
    modes, both = np.asarray(alone.modes), np.asarray(beside.modes)
    assert np.max(np.abs(modes[2])) <= IDENTITY
    shares = np.array([[0.0, 0.0, 0.5], [*modes[:, 0]]]) @ metric @ both
    assert_close(shares @ shares.T, np.eye(2), IDENTITY)
    assert np.array_equal(beside.snapshots.q, motion.q)
    with pytest.raises(rj.InputError, match="no motion given"):
        rj.pod([change])


@pytest.mark.slow
def test_derivatives_times_half_of_the_range(box):
    made = rj.sensitivities(box, TS, rtol=1e-10, solver=SOLVER, **TRUE)
    for name, one in zip(box.ranges, made, strict=True):
        ends = [{**TRUE, name: box.ranges[name].moved(TRUE[name], x)} for x in (-1e-4, 1e-4)]
        runs = [run(box.system(**x), TS, stabilization="default", rtol=1e-11) for x in ends]
        wanted = (np.asarray(runs[1].q) - np.asarray(runs[0].q)) / 2e-4
        assert_close(one.q, wanted, DIFFERENCED, scale=np.max(np.abs(wanted)))
        assert abs(box.ranges[name].share(ends[1][name], TRUE[name]) - 1e-4) <= SOLVED
    with pytest.raises(rj.InputError, match="no parameter 'weight'"):
        rj.sensitivities(box, TS, weight=1.0)


@pytest.mark.exhaustive
def test_parameters_by_few_full_runs(box, truth):
    """The optimum of the full model, although the reduced one misses a freedom."""
    measured = angle_and_amplitudes(truth)
    start = {"mass": 1.0, "f1": 21.0}
    settings = {"rank": 2, "solver": SOLVER, "noise": 1e-3, "start": start}
    best = rj.fit_over(box, TS, angle_and_amplitudes, measured, **settings)
    assert best.success
    assert best.rom.n == 2
    assert best.steps <= 6
    for name, value in TRUE.items():
        assert abs(best.parameters[name] - value) <= 1e-5 * value
        assert best.standard_errors[name] < 0.01 * value
    with pytest.raises(rj.InputError, match=r"see returns the shape \(31,\), but measured has"):
        rj.fit_over(box, TS, lambda motion: motion.q[:, 2], measured, solver=SOLVER)
    with pytest.raises(rj.InputError, match="lies outside of"):
        rj.fit_over(box, TS, angle_and_amplitudes, measured, start={"mass": 9.0})


@pytest.mark.slow
def test_full_runs_of_a_fit_in_a_folder(box, truth, tmp_path):
    """Another fit takes those at its points from there, and refuses those of other times."""
    measured = angle_and_amplitudes(truth)
    given = {"rank": 2, "solver": SOLVER, "runs": 2, "start": {"mass": 1.0, "f1": 21.0}}
    first = rj.fit_over(box, TS, angle_and_amplitudes, measured, path=tmp_path, **given)
    made = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/chunk-*.npz")}
    assert len(made) == 2
    again = rj.fit_over(box, TS, angle_and_amplitudes, measured, path=tmp_path, **given)
    assert again.parameters == first.parameters
    # Of other measurements the run at the start serves too.
    rj.fit_over(
        box, TS, angle_and_amplitudes, 1.01 * measured, path=tmp_path, **given | {"runs": 1}
    )
    assert made == {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/chunk-*.npz")}
    with pytest.raises(ValueError, match="holds another sweep, which differs in its parameters"):
        rj.fit_over(box, 2 * TS, angle_and_amplitudes, measured, path=tmp_path, **given)


def test_a_full_run_of_other_ranges_is_another_one(box):
    """Its derivatives are times half of them; in what order they are given is all the same."""

    def name(box, where):
        return FullRuns(box, jnp.asarray(TS), angle_and_amplitudes, {}).name(where)

    ranges, turned = box.ranges, dict(reversed(TRUE.items()))
    same = rj.Box(hanging, **dict(reversed(ranges.items())))
    assert name(same, turned) == name(box, TRUE)
    others = {"mass": rj.Range(0.1, 2.0)}, {"mass": (0.5, 4.0)}, {"f1": rj.Range(12.0, 30.0)}
    names = {name(rj.Box(hanging, **(ranges | other)), TRUE) for other in others}
    assert len(names | {name(box, TRUE), name(box, TRUE | {"mass": 1.0})}) == 5


@pytest.mark.slow
def test_sensitivities_of_training_runs_join_the_snapshots(box):
    """Of each run by each parameter; what they add to the subspace is no motion."""
    settings = {"candidates": 4, "held_out": 0, "formulation": "local"}
    reduced = rj.reduce_over(box, TS, 0.05, gradients=True, **settings)
    search = reduced.greedy.search
    assert len(search.sensitivities) == len(box.ranges) * len(search.truths)
    shapes = {x.q.shape for x in (*search.sensitivities, *search.truths)}
    assert len(shapes) == 1
    assert reduced.error <= 0.05
