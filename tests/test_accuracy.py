"""The study of accuracy and time: its reference, its front, and what it recommends."""

import csv
import dataclasses
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo

import romjax as rj
from romjax.basis.basis import Directions, RankCriterion
from romjax.pages import page
from romjax.study.accuracy.configuration import Configuration
from romjax.study.accuracy.models import default_caps
from romjax.study.accuracy.result import Accuracy
from romjax.study.accuracy.row import SINGLE_RUN, Condition, Row, with_front

TS = np.linspace(0.0, 1.0, 101)
DOPRI8 = diffrax.Dopri8()
# Required: the reference is so many times better than what is measured against it.
BETTER = 30
# Required: how far the slope of error against step is from the order of the method.
SLOPE = 0.3
# Required: on scenes that were not studied, the error is at most so many times that asked for.
HELD_OUT = 3


def study(scene: rj.Scene, rank: int, basis="POD", solvers=None) -> Accuracy:
    """Of the full model and one in so many minimal coordinates; 40 are refused."""
    return rj.accuracy(
        scene,
        TS,
        formulations=["minimal"],
        bases=[basis],
        ranks=[rank, 40],
        solvers=solvers,
        tolerances=[1e-3, 1e-5, 1e-7],
        precisions=["f64"],
        lanes=[1],
        repeats=2,
    )


@pytest.fixture(scope="module")
def scene() -> rj.Scene:
    return rj.gallery.chain(1)


class Wrong(rj.AbstractDecomposition):
    """A decomposition with a programming error."""

    rank: int | None = eqx.field(static=True, default=None)
    tol: Any = None
    offset: Any = None
    name: ClassVar[str] = "wrong"

    def criterion(self, snapshots):
        return RankCriterion(jnp.ones(2), 1e-12, snapshots.noise.positions)

    def directions(self, snapshots, rank) -> Directions:
        raise ValueError("a bug")


@pytest.mark.slow
def test_programming_errors_surface(scene):
    """They were listed as models that are refused."""
    with pytest.raises(ValueError, match="^a bug$"):
        rj.accuracy(
            scene, TS, bases=[Wrong()], solvers=[DOPRI8], tolerances=[1e-3], lanes=[1], repeats=1
        )


@pytest.fixture(scope="module")
def found(scene) -> Accuracy:
    return study(scene, 1, rj.SOD(), [DOPRI8])


@pytest.mark.slow
def test_all_configurations_are_measured(found):
    assert set(found.models) == {"full", "SOD minimal, r = 1"}
    assert len(found.rows) == len(found.models) * len(found.solvers) * 3
    for row in found.rows:
        assert not row.failure
        assert 0 < row.least <= row.median
        assert row.evaluations == row.steps * 13
        assert row.factorizations == 0
        assert (row.offline > 0) == (row.formulation != "full")
        assert row.memory > 0
        assert row.compile > 0
    assert "SOD minimal, r = 40" in found.skipped


@pytest.mark.slow
def test_a_model_says_what_it_was_made_of(found):
    """Of a formulation by name, and a decomposition that is an object."""
    full, other = found.models.values()
    assert full.reduction is None
    assert other.reduction.basis.name == "SOD"
    assert other.reduction.formulation.name == "minimal"
    assert {row.model: row.is_full for row in found.rows} == {full.name: True, other.name: False}


@pytest.mark.slow
def test_tighter_is_more_accurate(found):
    """And no error is near that of the reference, which is of other equations."""
    assert "minimal coordinates" in found.reference
    assert "redundant" in found.reference
    for model in found.models:
        for solver in found.solvers:
            errors = [r.error for r in found.rows if (r.model, r.solver) == (model, solver)]
            assert np.all(np.diff(errors) < 0)
            assert min(errors) >= BETTER * found.floor


@pytest.mark.slow
def test_front(found):
    """Nothing is both faster and more accurate than a row on the front, and something is than any
    other.
    """
    for row in found.rows:
        better = [r for r in found.rows if r.least < row.least and r.error < row.error]
        assert bool(better) != row.pareto


@pytest.mark.slow
def test_recommendation(found, scene):
    """The cheapest of what is accurate enough; its settings give that error."""
    wanted = 1e-3
    advice = found.recommend(wanted)
    good = [r for r in found.rows if r.error <= wanted]
    assert advice.row.least == min(r.least for r in good)
    assert advice.row.solver in str(advice)
    assert f"{advice.row.rtol:.0e}" in str(advice)
    assert set(advice.settings) == {"solver", "rtol"}
    system = rj.assemble(scene)
    truth = zoo.run(system, TS)
    error = rj.compare(truth, advice.simulate(system, TS)).error
    assert error <= wanted
    with pytest.raises(ValueError, match=r"nothing that was tried has an error of 1e-30; the best"):
        found.recommend(1e-30)


@pytest.mark.slow
def test_table(found):
    table = found.table()
    assert list(table.columns) == list(Row._fields)
    assert np.all(np.diff(table["error"]) >= 0)


@pytest.mark.slow
def test_figure_and_page(found, tmp_path):
    figure = rj.plot.accuracy(found)
    assert [axes.get_title() for axes in figure.axes] == [
        "double precision",
        "Rank",
        "Error over time",
        "When reduction pays",
    ]
    table, picture, text = page.write(found, "A <study>", tmp_path)
    with table.open() as file:
        lines = list(csv.DictReader(file))
    assert [float(line["error"]) for line in lines] == [row.error for row in found.rows]
    assert picture.stat().st_size > 10_000
    html = text.read_text()
    assert "A &lt;study&gt;" in html
    assert "data:image/png;base64," in html
    assert "://" not in html  # self-contained; base64 may spell any word, but has no colon
    assert html.count("<tr") == len(found.rows) + 1
    assert max(len(line) for line in page.summary(found).splitlines()) <= 80


def test_single_precision_has_no_reference():
    with jax.enable_x64(False), pytest.raises(ValueError, match="single precision.*enable_x64"):
        rj.accuracy(rj.gallery.cart_pendulum(), TS)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"formulations": ["newton"]}, "'newton'.*galerkin.*minimal.*projected"),
        ({"bases": ["PCA"]}, "'PCA' is none of POD, SOD"),
        ({"tolerances": []}, r"tolerances=\(\).*between 0 and 1"),
        ({"tolerances": [0.0]}, r"tolerances=\(0.0,\).*between 0 and 1"),
        ({"repeats": 0}, "repeats=0.*one repeat or more"),
        ({"precisions": ["f16"]}, "'f16' is none of f64, f32"),
        ({"steps": [0.0]}, r"steps=\(0.0,\).*longer than 0 s"),
        ({"lanes": [0]}, r"lanes=\(0,\).*one lane or more"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_bad_input(scene, wrong, words):
    with pytest.raises(ValueError, match=words):
        rj.accuracy(scene, TS, **wrong)


@pytest.mark.exhaustive
def test_recommendations_hold_on_other_scenes():
    """Of other amplitudes, frequencies and starts: the error, or the run is flagged."""
    wanted = 1e-5
    found = study(rj.gallery.cart_pendulum(), 3)
    # The reduced model's, which has the more to answer for, however fast the full one was.
    reduced = with_front([row for row in found.rows if row.formulation == "minimal"])
    advice = dataclasses.replace(found, rows=reduced).recommend(wanted)
    changes = [{"force": 8.0}, {"force": 12.0}, {"f1": 17.0}, {"frequency": 9.0}]
    scenes = [rj.gallery.cart_pendulum(**change) for change in changes]
    pushed = eqx.tree_at(
        lambda scene: [body.velocity for body in scene.bodies],
        scenes[0],
        [jnp.full(2, 0.1)] * 2,  # [m/s] along the rail
    )
    for scene in (*scenes, pushed):
        system = rj.assemble(scene)
        truth = rj.simulate(system, TS, rtol=1e-9)
        run = advice.simulate(system, TS)
        assert rj.compare(truth, run).error <= HELD_OUT * wanted or run.flags


@pytest.mark.exhaustive
def test_runs_that_fail_are_marked():
    """An explicit method on a beam of 100 kHz needs too many steps; the stiff one does not."""
    stiff = rj.gallery.cart_pendulum(f2=1e5)
    found = rj.accuracy(
        stiff,
        TS,
        formulations=[],
        caps=[],
        tolerances=[1e-5],
        solvers=[rj.Rodas5P(), DOPRI8],
        precisions=["f64"],
        lanes=[1],
        repeats=1,
    )
    assert {row.solver: row.failure for row in found.rows} == {
        "Rodas5P": "",
        "Dopri8": "MAX_STEPS",
    }
    assert all(row.least > 0 for row in found.rows)  # of a failed run, until it failed
    assert "failed" in [text.get_text() for text in figure_legend(found)]
    assert found.recommend(1e-2).row.solver == "Rodas5P"


@pytest.mark.exhaustive
def test_one_method_and_a_small_mechanism():
    """A pendulum, whose reduced model is of its one freedom."""
    found = rj.accuracy(
        rj.gallery.chain(1),
        np.linspace(0.0, 1.0, 11),
        formulations=["minimal"],
        bases=["POD"],
        tolerances=[1e-4, 1e-6],
        solvers=[DOPRI8],
        lanes=[1, 4],
        repeats=1,
    )
    assert set(found.models) == {"full", "POD minimal, r = 1"}
    assert all(row.solver == "Dopri8" and not row.failure for row in found.rows)
    wide, single, many = (
        {(r.model, r.rtol): r.error for r in found.rows if r.condition == condition}
        for condition in (SINGLE_RUN, Condition("f32", 1), Condition("f64", 4))
    )
    assert {rtol for _, rtol in single} == {1e-4}  # 1e-6 is out of reach
    for run, error in many.items():
        # By the lane of the loosest tolerance.
        assert 0.5 * wide[run] < error < 3 * wide[run]
    for run, error in single.items():
        assert 0.3 * wide[run] < error < 3 * wide[run]
    assert found.recommend(1e-3, lanes=4).row.lanes == 4
    assert "4 at once" in str(found.recommend(1e-3, lanes=4))
    with pytest.raises(ValueError, match="nothing was measured with lanes=5, only 1, 4"):
        found.recommend(1e-3, lanes=5)
    titles = [axes.get_title() for axes in rj.plot.accuracy(found).axes]
    assert "single precision, 4 at once" in titles
    assert "Of 4 runs at once" in page.summary(found)


@pytest.mark.exhaustive
def test_slopes_of_fixed_steps():
    """Error against step has the slope of the method's order; of the model without constraints,
    whose errors are the method's alone.
    """
    methods = [diffrax.Bosh3(), diffrax.Dopri5(), diffrax.Tsit5(), rj.Rodas5P()]
    found = rj.accuracy(
        rj.gallery.chain(1),
        np.linspace(0.0, 2.0, 3),
        formulations=["minimal"],
        bases=["POD"],
        ranks=[1],
        tolerances=[1e-9],
        solvers=methods,
        steps=[1 / 40, 1 / 64, 1 / 100],
        precisions=["f64"],
        lanes=[1],
        repeats=1,
    )
    for method in methods:
        slope = found.order("POD minimal, r = 1", type(method).__name__)
        assert slope == pytest.approx(method.order(None), abs=SLOPE)
    with pytest.raises(ValueError, match="'none' by 'Tsit5' has 0 runs in fixed steps"):
        found.order("none", "Tsit5")
    assert any("fixed steps" in text.get_text() for text in figure_legend(found))
    assert found.recommend(1e-4).settings.keys() <= {"solver", "rtol", "dt"}


def figure_legend(found):
    return rj.plot.accuracy(found).legends[0].get_texts()


@pytest.mark.slow
def test_interrupt_keeps_what_is_measured(scene, monkeypatch):
    """Ctrl-C while the second model is compiled: the first is there, the rest is listed."""
    compiled, made = Configuration.compiled, []

    def interrupted(*arguments):
        if made:
            raise KeyboardInterrupt
        made.append(compiled(*arguments))
        return made[0]

    monkeypatch.setattr(Configuration, "compiled", interrupted)
    settings = {"solvers": [rj.Rodas5P()], "tolerances": [1e-3], "lanes": [1], "repeats": 1}
    found = rj.accuracy(scene, TS, **settings)
    (row,) = found.rows
    assert row.model == "full"
    assert (row.evaluations, row.factorizations) == (8 * row.steps, row.steps)
    assert found.skipped["the rest"] == "interrupted"
    assert found.recommend(1e-1).row.least > 0


@pytest.mark.slow
def test_capped_modes_are_tried():
    """Unless others are asked for, above the lowest mode of a body and below the highest."""
    beam = rj.Beam("beam", 1.0, 1.0, frequencies=[8.0, 300.0], position=(0.5, 0.0))
    hinge = rj.Revolute(beam.at((-0.5, 0.0)), rj.ground.at())
    scene = rj.Scene([beam], [hinge], [rj.Gravity()])
    settings = {"tolerances": [1e-8], "precisions": ["f64"], "lanes": [1], "repeats": 1}
    found = rj.accuracy(scene, TS[:31], formulations=[], solvers=[DOPRI8], **settings)
    assert list(found.models) == ["full", "capped, 20 Hz", "capped, 40 Hz"]
    full, *slower = found.rows
    assert [row.formulation for row in slower] == ["capped"] * 2
    assert all(row.steps < full.steps / 3 for row in slower)
    assert all(full.error < row.error < 1e-4 for row in slower)
    best = found.recommend(1e-4)
    assert best.row.formulation == "capped"
    heavier = dataclasses.replace(beam, mass=jnp.asarray(2.0))
    other = rj.assemble(dataclasses.replace(scene, bodies=(heavier,)))
    run, truth = best.simulate(other, TS[:31]), zoo.run(other, TS[:31])
    assert rj.compare(truth, run).error <= HELD_OUT * best.error
    assert default_caps(rj.assemble(rj.cap(scene, 20.0))) == []
    with pytest.raises(rj.InputError, match=r"caps=\(-1\.0,\); give them in hertz"):
        rj.accuracy(scene, TS, caps=[-1.0])
