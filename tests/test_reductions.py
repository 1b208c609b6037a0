"""What pays: which models are tried, what they are judged by, and what is said of them."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import zoo
from comparison import assert_close
from matplotlib.figure import Figure
from tolerances import IDENTITY, SOLVED
from zoo import run

import romjax as rj
from romjax.common.plain import duration
from romjax.pages import report
from romjax.plot.labels import Label, place
from romjax.reduction.joint.formulation import faster_size
from romjax.trials.advice import advice, in_order, remark
from romjax.trials.attempt import Settings, Truth
from romjax.trials.candidates import families
from romjax.trials.clock import Clock
from romjax.trials.facts import Facts, beginning, freedoms
from romjax.trials.progress import Progress
from romjax.trials.reductions import INTERRUPTED, _untried
from romjax.trials.row import ReductionRow
from romjax.trials.search import GAINED, NO_TIME, Search, Try

RIGID = Facts(bodies=3, modes=0, freedoms=1, loops=True)


def kinds(**facts) -> list[str]:
    return [family.name for family in families(dataclasses.replace(RIGID, **facts))]


@pytest.mark.instant
def test_models_are_chosen_by_structure():
    """Tables are for few freedoms in the plane, caps and local bases for bodies that bend, samples
    for trees of many; subspaces come first where a drive repeats itself.
    """
    assert kinds() == ["table", "minimal", "galerkin"]
    assert kinds(freedoms=0, drives=1) == ["minimal", "galerkin"]
    assert kinds(space=True, jointed=True) == ["joint", "minimal", "galerkin"]
    assert kinds(space=True) == ["minimal", "galerkin"]
    chain = {"bodies": 8, "freedoms": 8, "loops": False, "tree": True, "jointed": True}
    assert kinds(**chain) == ["joint", "hyper", "minimal", "galerkin"]
    assert "hyper" not in kinds(**chain, space=True)
    bent = {"modes": 4, "freedoms": 5, "caps": (40.0, 80.0)}
    assert kinds(**bent)[:2] == ["capped", "local"]
    assert kinds(**bent, space=True)[:2] == ["capped", "local"]
    for space in (True, False):
        assert kinds(**bent, space=space, tree=True, jointed=True)[:2] == ["joint", "capped"]
    assert kinds(**chain, steps=5000)[:2] == ["minimal", "hyper"]
    assert "local" not in kinds()
    assert "capped" not in kinds(modes=4, freedoms=5)


@pytest.mark.instant
def test_a_subspace_of_all_comes_first_where_drives_close_loops_alone():
    """A drive that leaves freedoms does not repeat itself, and trees are for their joints."""
    driven = {"modes": 4, "caps": (40.0, 80.0), "drives": 1}
    assert kinds(**driven, freedoms=4)[:2] == ["galerkin", "capped"]
    assert kinds(**driven, freedoms=6)[-1] == "galerkin"
    assert kinds(**driven, freedoms=4, tree=True)[-1] == "galerkin"
    assert kinds(**driven, freedoms=4, space=True, tree=True, jointed=True)[0] == "joint"
    assert kinds(drives=1, space=True, jointed=True)[0] == "joint"


def test_facts_know_where_joint_coordinates_are_faster():
    """Trees, also where a drive closes one for itself; in the plane only those without."""
    four_bar, bars = (zoo.system(make) for make in (zoo.four_bar, zoo.bars))
    facts = Facts.of(zoo.bars(), bars)
    assert facts.tree
    assert facts.jointed
    assert faster_size(four_bar) is None
    assert faster_size(bars) == (2, 0)


def test_what_is_known_before_the_first_run():
    """The method with its reason, long before its program is compiled."""
    system, ts = zoo.system(zoo.bars), np.linspace(0.0, 1.0, 101)
    words = beginning(system, ts, None)
    assert words.endswith("at its start; Dopri8, since the outputs can show the fastest frequency")
    assert beginning(system, ts, zoo.RODAS5P).endswith("start; Rodas5P was asked for")


@pytest.mark.instant
def test_the_structure_in_words():
    """Known before any run; a drive beside its joint is no loop."""
    driven = dataclasses.replace(RIGID, drives=1, contacts=True)
    assert driven.describe() == "1 freedom, 1 drive, closed loops, contacts"
    whip = Facts(bodies=1, modes=5, freedoms=5, loops=True, tree=True, drives=1)
    assert whip.describe() == "5 freedoms, 5 modes of flexible bodies, 1 drive"
    bent = Facts(bodies=1, modes=1, freedoms=2)
    assert bent.describe() == "2 freedoms, 1 mode of flexible bodies"


@pytest.mark.instant
def test_kinds_of_models_begin_with_the_coarsest():
    """Scales go on from there by errors, and between what is wrong and what is right."""
    facts = Facts(2, 4, 5, caps=(10.0, 20.0, 40.0, 80.0))
    by_name = {f.name: f for f in families(facts)}
    assert [one.decomposition.rank for one in by_name["table"].candidates] == [2, 5]
    for name, first in (("local", 1e-3), ("capped", 40.0)):
        family = by_name[name]
        (one,) = family.candidates
        assert one.level == first
        finer = family.finer(one, excess=30.0)
        assert (finer.level < first) == (name == "local")
        middle = family.coarser(finer, excess=0.5, wrong=one)
        assert_close(middle.level**2, one.level * finer.level, IDENTITY)
        assert family.coarser(finer, excess=0.5, wrong=None) is None
        coarser = family.coarser(finer, excess=1e-3, wrong=None)
        assert (coarser.level > finer.level) == (name == "local")
    capped = by_name["capped"]
    last = capped.finer(capped.candidates[0], excess=1e6)
    assert last.cap == 80.0
    assert capped.finer(last, excess=1e6) is None


def test_freedoms_are_those_of_the_joints():
    """A hinge that is made twice takes none."""
    assert freedoms(zoo.system(zoo.bars)) == 2
    assert freedoms(zoo.system(zoo.four_bar)) == 1
    assert freedoms(zoo.system(zoo.four_bar, doubled=True)) == 1


def row(name="local r=7", speed_up=10.0, trained=1e-5, unseen=2e-5, **more) -> ReductionRow:
    given = {"formulation": "local", "rank": 7, "runs": 1, "steps": 90, "time": 1e-3, "made": 3.0}
    given |= {"compiled": 5.0, "pays_after": 80.0, "remark": ""} | more
    return ReductionRow(name=name, speed_up=speed_up, trained=trained, unseen=unseen, **given)


FULL = row("full", speed_up=1.0, trained=1e-8, unseen=math.nan, steps=120)


@pytest.mark.instant
def test_the_model_that_pays_comes_first():
    """A faster one that only repeats its training comes last, one that is no faster before it."""
    fast = row("minimal r=3", speed_up=20.0, unseen=0.4)
    slow = row("galerkin r=8", speed_up=0.8)
    accurate = row("capped 40 Hz", speed_up=9.0, trained=1e-7, unseen=1e-7)
    order = in_order([fast, slow, row(), accurate], 1e-3)
    assert [one.name for one in order] == [
        "capped 40 Hz",
        "local r=7",
        "galerkin r=8",
        "minimal r=3",
    ]
    words = advice(order, FULL, RIGID, 1e-3)
    assert words.startswith("Take capped 40 Hz: 9.0 times as fast")
    assert "after 80 runs" in words
    assert "to 1e-07 where it was not trained" in words
    alone = [row(unseen=math.nan)]
    assert "to 1e-05 on its training, since no other start" in advice(
        alone, FULL, RIGID, 1e-3, judged=False
    )
    assert "on its training, the only run" in advice(alone, FULL, RIGID, 1e-3)
    bent = row("minimal r=3", speed_up=20.0, hidden="deflection of rod is wrong by 84 %")
    words = advice([bent, row()], FULL, RIGID, 1e-3)
    assert words.startswith("Take local r=7")
    assert words.endswith(
        "minimal r=3 is 20.0 times as fast: its deflection of rod is wrong by 84 %."
    )
    words = advice([bent], FULL, RIGID, 1e-3)
    assert words.endswith(
        "But the deflection of rod is wrong by 84 %, which matters for stresses and joint forces."
    )


@pytest.mark.instant
@pytest.mark.parametrize(
    ("facts", "full", "why"),
    [
        ({"steps": 120}, FULL, "not stiff has nothing to leave out; its 120 steps"),
        ({"freedoms": 0}, FULL, "no equation of motion is left"),
        ({"contacts": True}, FULL, "impacts set the steps"),
        ({}, FULL._replace(trained=0.3), "chaotic"),
        ({"modes": 2, "freedoms": 3}, FULL, "take part in the motion"),
    ],
)
def test_why_nothing_pays(facts, full, why):
    assert advice([], full, RIGID, 1e-3).startswith("No model was made")
    words = advice([row(speed_up=0.5)], full, dataclasses.replace(RIGID, **facts), 1e-3)
    assert words.startswith("Nothing pays here: ")
    assert why in words


@pytest.mark.instant
def test_no_verdict_where_kinds_are_left():
    """Nor a cause, unless it holds whatever is tried; errors are of the runs that there were."""
    left = _untried({"local": NO_TIME, "joint": NO_TIME, "minimal": GAINED}, [65.0], 60.0)
    facts = dataclasses.replace(RIGID, modes=2)
    rows = [row(trained=2e-3, unseen=math.nan)]
    words = advice(rows, FULL, facts, 1e-3, left)
    assert words.startswith("No verdict: ")
    assert (
        "2 kinds were not tried for lack of time; give a larger `--budget`, such as 250." in words
    )
    assert "seen" not in words
    assert "errs by 2e-03 on its training, and takes " in words
    right = advice([row(speed_up=0.5)], FULL, facts, 1e-3, left)
    assert right.endswith("2.0 times as long.")
    for speed_up in (1.5, 4.0):
        good = [row(speed_up=speed_up)]
        assert ("2 kinds were not tried" in advice(good, FULL, facts, 1e-3, left)) == (speed_up < 2)
    chaos = advice(rows, FULL._replace(trained=0.3), facts, 1e-3, left)
    assert chaos.startswith("Nothing pays here: the motion is chaotic")
    assert _untried({"the rest": INTERRUPTED}, [], 60.0) == "the study was interrupted"
    assert not _untried({"minimal": GAINED}, [], 60.0)
    assert _untried({"finer galerkin": NO_TIME}, [1.0], 60.0).endswith("`--budget`, such as 120")
    for speed_up, said in ((4.0, "the best errs by 2e-03 on its training"), (0.5, "errs by 2e-03")):
        words = advice([rows[0]._replace(speed_up=speed_up)], FULL, facts, 1e-3)
        assert said in words
        assert "seen" not in words


@pytest.mark.instant
def test_times_have_three_digits_and_no_exponent():
    told = {2.1e-6: "0.0021 ms", 0.17649: "176 ms", 1.2345: "1.23 s", 1234.5: "1230 s"}
    assert {seconds: duration(seconds) for seconds in told} == told


@pytest.mark.instant
def test_what_is_told_meanwhile_has_80_columns(capsys):
    words = "closed loops, contacts; models to try, in some order: joint, capped, local, minimal"
    Progress(True).tell(words)
    first, second = capsys.readouterr().err.splitlines()
    assert len(first) <= 80
    assert second == "  minimal"


@pytest.mark.instant
def test_what_rests_has_nothing_to_reduce():
    facts = dataclasses.replace(RIGID, rests=True)
    assert advice([], FULL, facts, 1e-3).startswith("Nothing moves from this start")


def test_rounding_is_no_motion():
    """Errors of what rests are absolute, and it counts as resting."""
    system, motion = zoo.system(zoo.bars), zoo.motion(zoo.bars)
    noise = 1e-16 * np.sin(np.arange(motion.q.size)).reshape(motion.q.shape)
    resting = dataclasses.replace(motion, q=motion.q[:1] + noise)
    other = dataclasses.replace(motion, q=motion.q[:1] - noise)
    assert rj.compare(resting, other).error < SOLVED
    facts = Facts.of(zoo.bars(), system)
    assert facts.after(resting).rests
    assert not facts.after(motion).rests


def test_a_small_motion_in_single_precision():
    """One of ten micrometres about zero has relative errors; rounding of one that rests has not."""
    motion = zoo.motion(zoo.bars)
    start, metric = (np.asarray(x, np.float32) for x in (motion.q[:1], motion.metric))
    wave = np.float32(np.sin(np.arange(motion.q.size)).reshape(motion.q.shape))
    wave -= wave[:1]

    def error(q, other):
        truth, approx = (dataclasses.replace(motion, q=x) for x in (q, other))
        return rj.compare(truth, approx, metric).error

    small, rounding = np.float32(5e-6) * wave, np.finfo(np.float32).eps
    assert_close(error(small, 2 * small), 1.0, IDENTITY)
    assert error(start + rounding * wave, start - rounding * wave) < 100 * rounding


@pytest.mark.instant
@pytest.mark.parametrize(
    ("unseen", "why"), [(0.4, "impacts set"), (6e-3, "errs by 6e-03 on starts")]
)
def test_impacts_are_no_reason_where_steps_can_be_left_out(unseen, why):
    """As by a model that is twice as fast and nearly right, not by one that is wrong."""
    facts = dataclasses.replace(RIGID, modes=2, contacts=True)
    assert why in advice([row(speed_up=2.0, unseen=unseen)], FULL, facts, 1e-3)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("errors", "word"),
    [
        ((1e-5, 1e-4, 1e-8), ""),
        ((1e-5, 0.4, 1e-8), "wrong elsewhere"),
        ((0.3, 0.4, 1e-8), "even where it was trained"),
        ((0.3, 0.4, 0.2), "chaotic"),
        ((1e-5, math.inf, 1e-8), "cannot start"),
        ((math.inf, math.inf, 1e-8), "its run fails"),
    ],
)
def test_no_large_error_without_a_word(errors, word):
    said = remark(*errors, ())
    assert word in said
    assert bool(said) == bool(word)
    bent = remark(*errors, (), "deflection of rod is wrong by 84 %")
    assert bent.startswith("deflection of rod") == (not word)


@pytest.fixture(scope="module")
def found() -> rj.Reductions:
    """Made-up rows of a real motion."""
    system, motion = zoo.system(zoo.bars), zoo.motion(zoo.bars)
    wrong = row("minimal r=3, 3 runs", unseen=0.4, formulation="minimal", remark="wrong elsewhere.")
    rows = (row(), row("local r=8", rank=8, speed_up=3.0, trained=1e-7, unseen=1e-6), wrong)
    return rj.Reductions(
        rows=rows,
        models=(system,) * 3,
        runs=(motion,) * 3,
        tol=1e-3,
        full=FULL,
        system=system,
        truth=motion,
        advice=advice(rows, FULL, RIGID, 1e-3),
        refused={
            "table": "Tabulated: tables are made of mechanisms in the plane; in space use more."
        },
        skipped={"galerkin": "no time left in the budget", "hyper": "no time left in the budget"},
        pays=True,
        unseen=3,
    )


def test_a_summary_has_all_in_80_columns(found):
    """The best first, remarks, refusals in a sentence, and what there was no time for."""
    lines = found.summary().splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("Take local r=7: 10.0 times as fast")
    names = [line.split("  ")[0] for line in lines]
    assert [name for name in names if "r=" in name and ":" not in name] == [
        *("local r=7", "local r=8", "minimal r=3, 3 runs")
    ]
    for said in (
        "minimal r=3, 3 runs: wrong elsewhere.",
        "table: refused, Tabulated: tables are made of mechanisms in the plane.",
        "Not tried: galerkin, hyper; no time left in the budget.",
    ):
        assert said in lines


def test_what_holds_of_several_models_is_said_once(found):
    """With the names of all, and each reason with its own."""
    *good, wrong = found.rows
    rows = (*good, wrong, wrong._replace(name="minimal r=2"))
    skipped = {"galerkin": NO_TIME, "hyper": NO_TIME, "the rest": INTERRUPTED}
    notes = dataclasses.replace(found, rows=rows, skipped=skipped).notes()
    for said in (
        "minimal r=3, 3 runs; minimal r=2: wrong elsewhere.",
        f"Not tried: galerkin, hyper; {NO_TIME}.",
        f"Not tried: the rest; {INTERRUPTED}.",
    ):
        assert said in notes
    many = dataclasses.replace(found, rows=rows + rows[:3]).notes()
    assert "1 more model is slower or less accurate." in many


def test_pages_show_what_follows_the_motion(found):
    """Also a model whose deflections are wrong, which are little beside it."""
    best, other, wrong = found.rows
    hiding = best._replace(remark="deflection of rod is wrong by 84 %.")
    shown = report.best(dataclasses.replace(found, rows=(hiding, other, wrong)))
    assert [*shown] == [best.name, other.name]


def test_a_summary_of_models_that_were_not_run_unseen(found):
    """Says nothing of other starts."""
    rows = (row(trained=2e-3, unseen=math.nan),)
    words = dataclasses.replace(found, rows=rows, advice="", refused={}, skipped={}).summary()
    assert "errors on the training; made" in " ".join(words.split())


def test_the_figure_rings_the_recommended_model(found):
    """And frames the drop point of each kind; labels cover neither each other nor a point."""
    (axes,) = rj.plot.reductions(found).axes
    rings = [line for line in axes.lines if line.get_markersize() == 14]
    assert [tuple(map(float, np.ravel(ring.get_data()))) for ring in rings] == [(1.0, 2e-5)]
    frames = [line for line in axes.lines if line.get_markersize() == 10 and len(line.get_xdata())]
    assert [tuple(map(float, np.ravel(one.get_data()))) for one in frames] == [(1.0, 2e-5)]
    assert any(list(line.get_ydata()) == [found.tol] * 2 for line in axes.lines)
    (axes,) = rj.plot.reductions(dataclasses.replace(found, rows=found.rows[:1])).axes
    assert not [line for line in axes.lines if line.get_markersize() == 10]


@pytest.mark.filterwarnings("error")
def test_a_model_that_fails_unseen_is_a_hollow_point(found):
    """And a figure without any model has limits about the error that is asked for."""
    failed = row("minimal r=3", unseen=math.inf, formulation="minimal")
    one = dataclasses.replace(found, rows=(failed,), pays=False)
    (axes,) = rj.plot.reductions(one).axes
    assert [text.get_text() for text in axes.texts] == ["minimal r=3, fails unseen"]
    one = dataclasses.replace(found, rows=(row(time=5.4e-3, unseen=0.03),), pays=False)
    (axes,) = rj.plot.reductions(one).axes
    assert axes.get_xlim()[0] < 1.0 < 5.4 < axes.get_xlim()[1]
    none = dataclasses.replace(found, rows=(failed._replace(trained=math.inf),), pays=False)
    (axes,) = rj.plot.reductions(none).axes
    assert axes.get_ylim() == pytest.approx((1e-4, 1e-2))


def test_a_model_that_was_not_run_unseen_is_a_hollow_point(found):
    """Filled points are errors of runs that were held out."""
    rows = (row(time=1e-3), row("local r=4", time=2e-3, trained=2e-3, unseen=math.nan))
    (axes,) = rj.plot.reductions(dataclasses.replace(found, rows=rows)).axes
    spots = {True: set(), False: set()}
    for line in axes.lines:
        if line.get_marker() == "o" and line.get_markersize() == 6:
            every = line.get_markevery()
            points = np.reshape(line.get_xydata(), (-1, 2))
            kept = points if every is None else points[every]
            spots[line.get_markerfacecolor() == "white"] |= {tuple(map(float, x)) for x in kept}
    assert spots[False] == {(1.0, 2e-5)}
    assert spots[True] == {(1.0, 1e-5), (2.0, 2e-3)}


@pytest.mark.instant
def test_labels_cover_neither_each_other_nor_points():
    """Those of points on one spot are one."""
    figure = Figure(figsize=(6, 4))
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlim=(1, 100), ylim=(1e-8, 1))
    spots = [(10.0, 1e-4), (10.05, 1e-4), (13.0, 1.2e-4), (15.0, 1e-4), (99.0, 0.9)]
    labels = [Label(x, y, f"r={i}", "C0") for i, (x, y) in enumerate(spots)]
    spots.append((11.5, 1.6e-4))  # without words, where those of the first would stand
    place(figure, axes, [*labels, Label(*spots[-1], "", "C0")])
    boxes = [text.get_window_extent() for text in axes.texts]
    assert [text.get_text() for text in axes.texts] == ["r=0; r=1", "r=2", "r=3", "r=4"]
    points = axes.transData.transform(spots)
    for number, box in enumerate(boxes):
        assert not box.count_overlaps(boxes[:number])
        assert not box.count_contains(points)
        assert axes.bbox.count_contains(box.corners()) == 4


@pytest.mark.instant
def test_what_gains_much():
    settings = Settings(1e-3, 1e-8, None)

    def gains(error, work, hidden=""):
        tried = [SimpleNamespace(error=error, work=work, hidden=hidden)]
        return Search.gains.fget(SimpleNamespace(attempts=tried, settings=settings, once=1.0))

    assert gains(1e-4, 0.1)
    assert not gains(1e-4, 0.11)
    assert not gains(1e-2, 0.01)
    assert not gains(1e-4, 0.1, "deflection of rod is wrong by 84 %")
    clock = Clock(2e6)
    clock.taken.append(3e6)
    assert clock.has_time(known=True)
    assert not clock.has_time(known=False)


@pytest.mark.instant
@pytest.mark.parametrize(("work", "tried"), [(0.1, 4), (0.2, 6)])
def test_a_model_that_gains_much_leaves_three_kinds(monkeypatch, work, tried):
    """Whatever the time, so that a second run repeats the first. Coarser ones are looked for among
    those that were tried; of these, where one gains much, those that compile nothing.
    """
    kinds = [SimpleNamespace(name=f"kind {i}", candidates=[i], compiles=i != 1) for i in range(6)]
    monkeypatch.setattr("romjax.trials.search.families", lambda facts: kinds)
    seen = SimpleNamespace(facts=SimpleNamespace(rests=False), attempts=[], skipped={})
    seen.settings, seen.once, seen.truths = Settings(1e-3, 1e-8, None), 1.0, lambda changes: []
    coarsened = []
    seen.coarsen = lambda one, clock: coarsened.append(one.family.name)

    class Trying(SimpleNamespace):
        gains, leave, try_all = Search.gains, Search.leave, Search.try_all

        def step(self, one):
            model = SimpleNamespace(error=1e-4, work=work, hidden="")
            self.attempts.append(model)
            one.right, one.candidate, one.models = (one.candidate, model), None, 1

    search = Trying(**vars(seen))
    search.try_all(1e6)
    assert len(search.attempts) == tried
    coarser = [one for one in kinds[:tried] if tried == len(kinds) or not one.compiles]
    assert coarsened == [one.name for one in coarser]
    left = [f"coarser {one.name}" for one in kinds[:tried] if one not in coarser]
    assert [*search.skipped] == [*(one.name for one in kinds[tried:]), *left]


@pytest.mark.instant
def test_a_kind_is_refined_until_deflections_are_right_too():
    """The norm of a motion has little of them; stresses and joint forces have."""
    family = {f.name: f for f in families(Facts(2, 4, 5, caps=(10.0, 80.0)))}["local"]
    one, search = Try.of(family), SimpleNamespace(settings=Settings(1e-3, 1e-8, None), once=1.0)
    search.facts = SimpleNamespace(quick=False)
    tried = SimpleNamespace(error=5e-4, trained=5e-4, unseen=5e-4, work=0.1, hidden="wrong by 84 %")
    first = one.candidate
    Search.judge(search, one, tried)
    assert one.right is None
    assert one.wrong is first
    finer = one.candidate
    assert finer.level < first.level
    tried.hidden = ""
    Search.judge(search, one, tried)
    assert one.candidate is None
    assert one.right == (finer, tried)


@pytest.mark.instant
def test_a_kind_that_there_was_no_time_to_refine_is_named():
    """Its first model may be wrong only for its few modes."""
    kinds = [SimpleNamespace(name=name, candidates=[1]) for name in ("galerkin", "local", "table")]
    tries = [Try.of(kind) for kind in kinds]
    tries[0].models, tries[2].refused = 1, 1
    search = SimpleNamespace(skipped={})
    Search.leave(search, tries, NO_TIME)
    assert search.skipped == {"local": NO_TIME, "finer galerkin": NO_TIME}


@pytest.mark.instant
@pytest.mark.parametrize(("compiled", "audited"), [(1.0, True), (100.0, False)])
def test_the_truth_has_its_balance_of_energy(monkeypatch, compiled, audited):
    """At its own tolerance, unless the full model compiles for long."""

    def simulated(system, ts, rtol, solver, audit):
        return SimpleNamespace(rtol=rtol, solver=solver, audited=audit)

    monkeypatch.setattr("romjax.trials.search.simulated", simulated)
    rough, sharp = (simulated(None, None, rtol, "method", False) for rtol in (1e-8, 1e-10))
    given = {"scene": None, "system": None, "ts": None, "facts": RIGID, "once": 0.1}
    given |= {"settings": Settings(1e-3, 1e-8, None), "progress": Progress(False)}
    search = Search(full=rough, compiled=compiled, training=[Truth(None, sharp, 0.2)], **given)
    search.audit()
    for now, before in ((search.full, rough), (search.training[0].run, sharp)):
        assert_close(now.rtol, before.rtol, IDENTITY, scale=before.rtol)
        assert now.solver == "method"
        assert now.audited == audited


@pytest.mark.instant
@pytest.mark.parametrize("wrong", [{"tol": 0.0}, {"rtol": 2.0}, {"budget": 0.0}])
def test_numbers_without_meaning(wrong):
    scene = rj.Scene([rj.RigidBody("body", 1.0, 1.0)])
    with pytest.raises(rj.InputError, match="reductions: tol="):
        rj.reductions(scene, np.linspace(0.0, 1.0, 11), **wrong)


@pytest.mark.exhaustive
def test_a_whole_table():
    """Of the cart-pendulum: a stiff mode that hardly moves is left out by each kind of model."""
    found = rj.reductions(zoo.cart_pendulum(), np.linspace(0.0, 1.0, 101), budget=50.0)
    best = found.recommended
    assert best.speed_up > 3
    assert best.error < 1e-3
    assert {one.formulation for one in found.rows} >= {"local", "capped"}
    text = found.summary(every=True)
    assert max(map(len, text.splitlines())) <= 80
    assert text.startswith(f"Take {best.name}: ")
    table = found.table()
    assert list(table["name"][:2]) == ["full", best.name]
    figure = rj.plot.reductions(found)
    assert "recommended" in [text.get_text() for text in figure.legends[0].get_texts()]
    rom = found.model()
    energies = rj.energy(found.system, found.truth)
    assert_close(energies.balance, 0.0, SOLVED, scale=np.max(energies.kinetic))
    again = run(rom, found.truth.t, rtol=1e-8)
    assert_close(rj.compare(found.truth, again).error, best.trained, SOLVED, scale=1.0)
