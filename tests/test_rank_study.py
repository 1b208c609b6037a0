"""What each mode buys: errors, steps and times of reduced models by rank."""

import dataclasses
import itertools

import numpy as np
import pytest
from motions import through
from tolerances import IDENTITY
from zoo import run

import romjax as rj
from romjax.study.ranks.rank_study import RankRow

COUNT, RTOL = 3, 1e-8


def system(spin=0.0) -> rj.AbstractSystem:
    """Bars hinged by springs, that fall from the level."""
    bars = [
        rj.RigidBody(
            f"bar{i}",
            1.0,
            1 / 12,
            (i + 0.5, 0.0),
            velocity=(0.0, spin * (i + 0.5)),
            angular_velocity=spin,
        )
        for i in range(COUNT)
    ]
    ends = [rj.ground.at(), *(bar.at((0.5, 0.0)) for bar in bars)]
    hinges = [rj.Revolute(bar.at((-0.5, 0.0)), end) for bar, end in zip(bars, ends, strict=False)]
    springs = [
        rj.TorsionSpring(b.at((-0.5, 0.0)), a.at((0.5, 0.0)), stiffness=300.0)
        for a, b in itertools.pairwise(bars)
    ]
    return rj.assemble(rj.Scene(bars, hinges, [rj.Gravity(), *springs]))


def simulated(system):
    return run(system, np.linspace(0.0, 0.5, 51))


@pytest.fixture(scope="module")
def training():
    return simulated(system())


@pytest.fixture(scope="module")
def study(training):
    return rj.rank_study(
        system(),
        training,
        [system(spin=1.0)],
        ranks=[2, 1, COUNT + 1],
        formulations=["minimal", "local"],
        rtol=RTOL,
        repeats=1,
    )


@pytest.mark.parametrize("wrong", [{"ranks": [0, 1]}, {"ranks": []}, {"repeats": 0}])
def test_wrong_numbers(wrong):
    bars = system()
    with pytest.raises(rj.InputError, match="give positive numbers of both"):
        rj.rank_study(bars, through(bars), **wrong)


@pytest.mark.slow
def test_errors_are_those_of_runs(study, training):
    """Of the training, and of the start that was held out."""
    assert [(row.formulation, row.rank) for row in study.rows] == [("minimal", 1), ("minimal", 2)]
    other = simulated(system(spin=1.0))
    for row in study.rows:
        rom = study.model(row)
        assert rom.n == row.rank
        moved = rom.starting_at(other.q[0], other.v[0])
        run, held_out = (rj.simulate(x, training.t, rtol=RTOL, audit=False) for x in (rom, moved))
        assert abs(row.trained - float(rj.compare(training, run).error)) <= IDENTITY
        # The reference of the held-out run is one of a batch.
        assert abs(row.held_out / float(rj.compare(other, held_out).error) - 1) <= 1e-3
        assert row.steps == int(run.stats.num_steps)
        assert row.error == max(row.trained, row.held_out)
        assert row.least > 0


@pytest.mark.slow
def test_what_is_refused_is_named(study):
    assert list(study.refused) == ["minimal, r = 4", "local, r = 1", "local, r = 2", "local, r = 4"]
    assert "no body that deforms" in study.refused["local, r = 1"]


def rows(*numbers) -> tuple[RankRow, ...]:
    return tuple(RankRow("minimal", *row) for row in numbers)


@pytest.mark.slow
def test_a_mode_pays_if_the_error_falls_by_more_than_the_steps_grow(study):
    measured = dataclasses.replace(
        study,
        full=1.0,
        rows=rows(
            (1, 1e-2, 2e-2, 50, 0.1),
            (2, 8e-5, 9e-5, 160, 0.2),
            (3, 6e-5, 7e-5, 430, 0.5),  # 1.3 times as accurate for 2.7 times the steps
            (4, np.inf, np.inf, 10, 0.1),  # a run failed
            (5, 1e-9, 1e-9, 900, 1.1),  # slower than the full model
        ),
    )
    assert measured.best().rank == 2
    assert [row.rank for row in measured.paying("minimal")] == [1, 2, 3]
    alone = dataclasses.replace(measured, rows=rows((1, 1e-2, np.nan, 50, 0.1)))
    assert alone.best().error == 1e-2
    with pytest.raises(rj.InputError, match="no model of formulation 'local' is faster than"):
        measured.best("local")


@pytest.mark.slow
def test_the_table(study):
    frame = study.table()
    assert list(frame["rank"]) == [1, 2]
    assert np.allclose(frame["speed_up"] * frame["least"], study.full)


@pytest.mark.slow
def test_the_figure(study):
    """Each model is a point with its rank; the one that pays has a ring."""
    measured = dataclasses.replace(
        study, full=1.0, rows=rows((1, 1e-2, 2e-2, 50, 0.1), (2, 8e-5, 9e-5, 160, 0.2))
    )
    (axes,) = rj.plot.reduction(measured).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert np.allclose(lines['"minimal"'].get_xydata(), [(100, 2e-2), (200, 9e-5)])
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    rings = [line for line in axes.get_lines() if line.get_markersize() == 14]
    assert np.allclose(rings[0].get_xydata(), [(200, 9e-5)])
    (slow,) = rj.plot.reduction(dataclasses.replace(measured, full=0.0)).axes
    assert not [line for line in slow.get_lines() if line.get_markersize() == 14]
