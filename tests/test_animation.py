"""Pictures that move: pages hold what the outlines are, and everything that they need."""

import dataclasses
import gc
import html
import re
import sys
import types
from importlib import resources

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from motions import cart_and_beam, motion
from outlined import marker_places
from page_data import apart, data, decode, decoded
from PIL import Image
from tolerances import IDENTITY

import romjax as rj
from romjax.assembly.outlines import MovingOutline, outlines
from romjax.pages import report
from romjax.plot.motion.arrows import arrow
from romjax.plot.motion.designs import course
from romjax.plot.motion.frames import Clock, Model, exaggeration, playing_rate
from romjax.plot.motion.hulls import faces
from romjax.plot.motion.outputs import Output, outputs_of
from romjax.plot.motion.page import PIECES, player
from romjax.scene.outline import STYLES

# Required: of a page of 10 s [bytes], and of a point in a picture of 1000 pixels [pixels].
SIZE, PIXELS = 500_000, 0.25


@pytest.fixture(scope="module")
def scene() -> rj.Scene:
    return cart_and_beam()


@pytest.fixture(scope="module")
def run(scene) -> rj.Trajectory:
    return motion(scene)


@pytest.fixture(scope="module")
def tip(scene) -> rj.Marker:
    return scene.bodies[1].at((1.0, 0.0))


@pytest.fixture(scope="module")
def moving(scene, run, tip) -> rj.Animation:
    """Two models and a trace."""
    return rj.animate(scene, run, motion(scene, 0.12), labels=["full", "<b>POD</b>"], trace=tip)


@pytest.fixture(scope="module")
def hanging() -> rj.AbstractSystem:
    """Two hinged bars."""
    return zoo.system(zoo.bars)


@pytest.fixture(scope="module")
def falling(hanging) -> rj.Trajectory:
    return zoo.run(hanging, np.linspace(0.0, 0.3, 31))


def broken(run: rj.Trajectory) -> rj.Trajectory:
    """A run that got to its first twenty outputs."""
    q, v = np.array(run.q), np.array(run.v)
    q[20:], v[20:] = np.nan, np.nan
    return dataclasses.replace(run, q=jnp.asarray(q), v=jnp.asarray(v))


# The page.


def test_the_page_holds_all_outlines(scene, run, tip, moving):
    told = data(moving.html())
    assert [model["name"] for model in told["models"]] == ["full", "<b>POD</b>"]
    np.testing.assert_allclose(decode(told["times"], told["frames"])[:, 0], run.t, atol=1e-6)
    wanted = outlines(scene, run.t, run.q, [tip])
    # Signs are of one size in all models.
    actual = moving.models[0].actual
    assert [(o.part, o.style) for o in actual] == [(o.part, o.style) for o in wanted]
    for drawn, own in zip(actual, wanted, strict=True):
        if own.style in ("body", "trace", "hinge"):
            np.testing.assert_allclose(drawn.points, own.points, atol=IDENTITY)
    for index, model in enumerate(moving.models):
        assert apart(decoded(told, index), model.actual) <= PIXELS


def test_deformations_are_multiplied(scene, run, moving):
    """Rigid motions and deformations are apart: by 0 the beam is straight, by 1 as it is."""
    told = data(rj.animate(scene, run, deformation=3.0).html())
    assert told["scale"] == 3.0
    assert {0.0, 1.0, 3.0} <= set(told["scales"])
    (model,) = rj.animate(scene, run).models
    rigid, actual = model.undeformed[1], outlines(scene, run.t, run.q)[1]
    ways = np.diff(rigid.points, axis=1)
    np.testing.assert_allclose(ways, np.broadcast_to(ways[:, :1], ways.shape), atol=IDENTITY)
    for scale in (0.0, 1.0, 3.0):
        beam = rigid._replace(points=rigid.points + scale * (actual.points - rigid.points))
        assert apart(decoded(told, 0, scale)[1:2], [beam]) <= PIXELS
    assert moving.models[0].deformed(0.0)[1].points == pytest.approx(rigid.points)


def test_exaggerated_bodies_stay_in_their_joints():
    """The end of a beam stays in the hinge of the next, whatever its deflections are multiplied by:
    to the second order of these, which a straight line between two positions leaves out.
    """
    beams = zoo.system(zoo.falling_beams)
    (model,) = zoo.run(beams, np.linspace(0.0, 0.3, 31)).animate().models
    for scale in (0.0, 1.0, 10.0):
        first, second, *_ = model.deformed(scale)
        gaps = np.linalg.norm(first.points[:, -1] - second.points[:, 0], axis=1)
        bends = np.max(np.abs(first.points - model.undeformed[0].points))
        assert np.max(gaps) <= IDENTITY + bends**2
        assert np.max(np.abs(first.points[:, 0])) <= IDENTITY + bends**2


def test_what_does_not_bend_has_no_deformation(falling):
    told = data(falling.animate().html())
    assert told["scales"] == []
    assert all(part["bend"] is None for part in told["models"][0]["parts"])


def test_a_page_of_ten_seconds_is_small():
    many = rj.gallery.chain(16)
    page = rj.animate(many, motion(many, 0.3, end=10.0, count=1001)).html()
    assert data(page)["frames"] == 600
    assert len(page.encode()) < SIZE


def test_a_page_of_space_is_small_too():
    """Three coordinates of each point, of bodies that turn freely."""
    many = rj.gallery.ball_chain(16)
    page = rj.animate(many, motion(many, 0.3, end=10.0, count=1001), view=(0.1, 0.2)).html()
    told = data(page)
    assert (told["dimension"], told["frames"], told["view"]) == (3, 600, [0.1, 0.2])
    assert len(page.encode()) < SIZE


def test_the_page_needs_nothing_else(moving):
    """No address of anything, and names cannot end what they stand in."""
    page = moving.html()
    text = page.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?:|\bsrc=|\bhref=|@import|url\((?!#)", text)
    assert page.count("<script") == page.count("</script>") == 2
    assert "<b>POD" not in page


@pytest.mark.instant
def test_the_player_finds_its_elements():
    script, page = "".join(player(f"{name}.js") for name in PIECES), player("page.html")
    asked = set(re.findall(r'element\("(\w+)"\)', script))
    assert len(asked) >= 12
    assert asked <= set(re.findall(r'\bid="(\w+)"', page))
    known = set(re.findall(r'"(\w+)"', player("draw.js")))
    assert set(STYLES) <= known
    folder = resources.files("romjax.plot.motion") / "player"
    assert {path.name for path in folder.iterdir() if path.name.endswith(".js")} == {
        f"{name}.js" for name in PIECES
    }


def test_notebooks_show_it_in_a_frame(moving, scene, falling):
    shown = moving._repr_html_()
    (inside,) = re.findall(r'^<iframe srcdoc="([^"]*)"', shown)
    assert html.unescape(inside) == moving.html()
    assert '"frames":1,' in html.unescape(scene._repr_html_())
    assert rj.Scene([])._repr_html_() is None
    assert '"frames":31,' in html.unescape(falling._repr_html_())
    assert len(repr(moving)) < 100
    assert f"{len(moving.t)} frames" in repr(moving)


def test_a_comparison_shows_both_motions(falling, only_new_garbage):
    """As long as both are there, and know their mechanism."""
    approx = falling.every(1)
    report = rj.compare(falling, approx)
    assert html.unescape(report._repr_html_()).count('"name":"truth"') == 1
    del approx
    gc.collect()
    assert report._repr_html_() is None
    made_up = motion(zoo.bars())
    assert rj.compare(made_up, made_up)._repr_html_() is None


def test_the_path_of_a_marker(scene, run, tip, moving):
    (trace,) = (o for o in moving.models[0].actual if o.style == "trace")
    (wanted,) = marker_places(scene, [tip], run.q)
    np.testing.assert_allclose(trace.points[:, 0], wanted, atol=IDENTITY)


def test_few_frames_are_not_smoothed(hanging, falling):
    """Points that move along arcs between the frames would move along chords."""
    assert data(falling.animate().html())["smooth"]
    turning = np.array(falling.q)
    turning[:, 2] = 1.5 * np.arange(31)
    wild = dataclasses.replace(falling, q=jnp.asarray(turning))
    assert not data(rj.animate(hanging, wild).html())["smooth"]


@pytest.mark.instant
def test_playing_speeds_are_round():
    assert [playing_rate(x) for x in (0.0, 5.0, 10.0, 1.0, 0.1, 300.0)] == [1, 1, 1, 0.2, 0.02, 50]


# What is drawn.


def test_runs_at_other_times_are_shown_at_those_of_the_first(scene, run):
    """By Hermite's polynomials, of a motion of degree three exactly; to the end of each run."""
    t = np.linspace(0.0, 0.7, 6)
    slope = np.linspace(-1.0, 1.0, run.q.shape[1])
    q, v = (slope * (x**3)[:, None] for x in (t, np.cbrt(3 * t**2)))
    short = dataclasses.replace(run, t=jnp.asarray(t), q=jnp.asarray(q), v=jnp.asarray(v))
    names = [model.name for model in rj.animate(scene, run, short, labels=["long", "short"]).models]
    assert names == ["long", "short (until 0.7 s)"]
    wanted = np.asarray(run.t)
    found = course(short, wanted)
    np.testing.assert_allclose(found[:15], slope * (wanted[:15] ** 3)[:, None], atol=IDENTITY)
    assert np.all(np.isnan(found[15:]))


def test_designs_are_drawn_by_their_own_numbers(falling):
    """Bars of another length, over those of the first."""
    other = zoo.run(zoo.system(zoo.bars, length=1.5), falling.t)
    drawn = [model.actual[0].points[0] for model in falling.animate(other).models]
    sizes = [np.ptp(points[:, 0]) for points in drawn]
    assert sizes == pytest.approx([1.0, 1.5], abs=IDENTITY)


def test_forces_of_joints_are_arrows(hanging, falling):
    """From the hinge along its force, all on one scale, the longest a share of the picture."""
    shown = rj.animate(hanging, falling, forces=True)
    arrows = [o.points for o in shown.models[0].actual if o.part.startswith("force of ")]
    forces = [np.asarray(own.force) for own in rj.joint_forces(hanging, falling).values()]
    ways = [points[:, 1] - points[:, 0] for points in arrows]
    scale = np.max(np.linalg.norm(ways, axis=2)) / np.max(np.linalg.norm(forces, axis=2))
    np.testing.assert_allclose(ways, scale * np.array(forces), atol=IDENTITY)
    np.testing.assert_allclose(arrows[0][:, 0], 0.0, atol=1e-6)
    assert apart(decoded(data(shown.html()), 0), shown.models[0].actual) <= PIXELS
    shown = rj.animate(hanging, broken(falling), forces=True)
    held = [o.points[19:] for o in shown.models[0].actual if o.part.startswith("force of ")]
    np.testing.assert_array_equal(held, np.repeat(np.array(held)[:, :1], 12, axis=1))


def test_resultants_are_colours(tmp_path):
    """Of beams at even distances, to a pixel, on one scale for all frames."""
    beams = zoo.system(zoo.falling_beams)
    falling = zoo.run(beams, np.linspace(0.0, 0.3, 31))
    name, half = "beam1", float(zoo.falling_beams().bodies[0].length) / 2

    def along(animation):
        outlines = animation.models[0].actual
        return next(o.values for o in outlines if (o.part, o.style) == (name, "body"))

    shown = rj.animate(beams, falling, resultant="moment", deformation=2.0)
    wanted = rj.resultants(beams, falling, name, np.linspace(-half, half, 41)).moment
    np.testing.assert_array_equal(along(shown), wanted)
    told = data(shown.html())
    (part,) = (x for x in told["models"][0]["parts"] if x["name"] == name)
    size = told["colours"]["largest"]
    assert size >= np.max(np.abs(wanted)) > 0
    assert told["colours"]["least"] == -size
    np.testing.assert_allclose(decode(part["values"], 31), wanted, atol=size / 500)
    assert [o["coloured"] for o in part["outlines"]] == [True]
    assert apart(decoded(told, 0, 2.0), shown.models[0].deformed(2.0)) <= PIXELS
    with Image.open(shown.save(tmp_path / "x.gif", fps=10, seconds=0.2)) as picture:
        picture.seek(1)
        colours = np.asarray(picture.convert("RGB")).astype(int)
    # Not all grey, above the scale of colours.
    assert np.max(np.ptp(colours[: len(colours) // 2], axis=2)) > 100
    last = np.asarray(wanted)[np.minimum(np.arange(31), 19)]
    shown = rj.animate(beams, broken(falling), resultant="moment")
    np.testing.assert_array_equal(along(shown), last)


@pytest.mark.instant
def test_arrows_have_heads_in_space():
    """Of the same length on both sides, and across."""
    way = np.array([[1.0, 2.0, 2.0], [0.0, 0.0, 3.0]])
    points = arrow(np.zeros((2, 3)), way)
    left, right = points[:, 2] - points[:, 1], points[:, 4] - points[:, 1]
    np.testing.assert_allclose(np.sum((left - right) * way, axis=1), 0.0, atol=IDENTITY)
    lengths = np.linalg.norm(left, axis=1), np.linalg.norm(right, axis=1)
    np.testing.assert_allclose(*lengths)


@pytest.mark.instant
def test_boxes_have_faces():
    """Seen from outside counter-clockwise: their areas are vectors that sum up to nothing, and the
    volume below each, from the middle, to that of the box. What is bent, or flat, has none.
    """
    path = "000 100 110 010 000 001 101 100 101 111 110 111 011 010 011 001"
    corners = np.array([[int(digit) for digit in corner] for corner in path.split()]) - 0.5
    turn, _ = np.linalg.qr(np.array([[2.0, 1.0, 0.0], [-1.0, 1.0, 3.0], [0.5, 0.0, 1.0]]))
    turn = turn * np.linalg.det(turn)
    for box in (
        corners * (1.0, 2.0, 3.0),
        1e3 * corners @ turn.T * (1.0, 1.0, 1.0),
        1e-3 * corners,
    ):
        found = faces(box)
        assert sorted(map(len, found)) == [4] * 6
        ways = [np.cross(box[b] - box[a], box[d] - box[a]) for a, b, _, d in found]
        volume = (
            sum(way @ box[face].mean(axis=0) for way, face in zip(ways, found, strict=True)) / 3
        )
        np.testing.assert_allclose(np.sum(ways, axis=0), 0.0, atol=IDENTITY * volume ** (2 / 3))
        edges = [np.linalg.norm(box[1] - box[0]), np.linalg.norm(box[2] - box[1])]
        np.testing.assert_allclose(volume, np.prod([*edges, np.linalg.norm(box[5] - box[4])]))
    angle = np.linspace(0.0, 4.0, 30)
    helix = np.stack([np.cos(angle), np.sin(angle), angle], axis=1)
    for line in (helix, corners * (1.0, 1.0, 0.0), np.zeros((16, 3)), corners * np.nan):
        assert faces(line) == []


@pytest.mark.instant
def test_outputs_are_plotted():
    """The page is told all curves, to a pixel; nothing is left where a run has ended."""
    t = np.linspace(0.0, 1.0, 30)
    outline = [MovingOutline("bar", np.stack([t, t**2], axis=1)[:, None], "point", False)]
    curves = np.stack([np.sin(9 * t), np.cos(9 * t)], axis=1)
    still = np.zeros((30, 1))
    shown = [Output("force [N]", curves), Output("nothing", still)]
    moving = rj.Animation(t, [Model("", outline, [])], Clock("t", "s", 1.0), outputs=shown)
    told = data(moving.html())["outputs"]
    assert [(one["name"], one["curves"]) for one in told] == [("force [N]", 2), ("nothing", 1)]
    np.testing.assert_allclose(decode(told[0]["values"], 30), curves, atol=1e-3)
    np.testing.assert_array_equal(decode(told[1]["values"], 30), still)
    bare = rj.Animation(t, moving.models, moving.clock)
    tall = [int(re.findall(r"height: (\d+)px", x.embedded())[-1]) for x in (moving, bare)]
    assert tall[0] == tall[1] + 2 * 84


def test_outputs_are_those_of_runs(falling):
    """Coordinates by name or by how far they move, and what one has measured; refused otherwise."""
    some = np.arange(0, 31, 3)
    q = np.asarray(falling.q)

    def plotted(wanted):
        return outputs_of(wanted, [falling], [q[some]], some)

    (named,) = plotted(["bar2.phi"])
    assert named.name == "bar2.phi [rad]"
    np.testing.assert_array_equal(named.values[:, 0], q[some, 5])
    assert len(plotted(2)) == 2
    measured = np.where(np.arange(31) < 20, np.asarray(falling.t), np.nan)
    (own,) = plotted({"time [s]": measured})
    np.testing.assert_allclose(own.values[:, 0], np.minimum(falling.t[some], falling.t[18]))
    told = data(falling.animate(outputs=["bar1.x"]).html())["outputs"]
    assert [one["name"] for one in told] == ["bar1.x [m]"]
    for wanted, words in (
        (["bar3.x"], "no coordinate 'bar3.x'"),
        ({"x": np.zeros(3)}, "has shape .3,., but its run has 31 outputs"),
        ({"x": [np.zeros(31)] * 2}, "2 curves for 1 runs"),
        ({"x": np.full(31, np.nan)}, "no finite number"),
    ):
        with pytest.raises(rj.InputError, match=words):
            plotted(wanted)
    with pytest.raises(rj.InputError, match="those of a run; give one"):
        outputs_of(1, [], [], some)


@pytest.mark.instant
def test_small_deformations_are_exaggerated():
    """Where they are below a hundredth of the picture, by a round number; beneath is the rest."""
    bar = np.stack([np.linspace(0.0, 1.0, 5), np.zeros(5)], axis=1)[None]
    for size, wanted in ((3e-4, 100.0), (0.05, 1.0), (1e-12, 1.0)):
        bent = bar + size * np.sin(np.pi * bar[:, :, :1]) * np.array([0.0, 1.0])
        sides = [[MovingOutline("bar", points, "body", False)] for points in (bent, bar)]
        assert exaggeration([Model("", *sides)]) == wanted
    assert exaggeration([Model("", sides[0], [])]) == 1.0


def test_a_run_knows_its_mechanism(hanging, falling):
    own, told = falling.animate(), rj.animate(hanging, falling)
    assert own.models[0].name == told.models[0].name == ""
    for one, other in zip(own.models[0].actual, told.models[0].actual, strict=True):
        assert one.style == other.style
        np.testing.assert_allclose(one.points, other.points, atol=IDENTITY)
    assert [o.part for o in own.models[0].actual[:2]] == ["bar1", "bar2"]
    assert own.models[0].actual[0].points.shape[0] == 31


def test_a_reduced_run_knows_its_mechanism(hanging, falling):
    turns = np.array([[0.0, 0.5, 1.0, 0.0, 1.5, 1.0], [0.0, 0.0, 0.0, 0.0, 0.5, 1.0]])
    rom = rj.reduce(hanging, rj.Basis.from_modes(turns.T, hanging.q0), rj.Minimal())
    approx = zoo.run(rom, falling.t)
    assert len(falling.animate(approx.every(1), labels=["full", "two"]).models) == 2
    parts = [o.part for o in approx.every(3).animate().models[0].actual]
    assert parts[:2] == ["bar1", "bar2"]


def test_each_mode_swings(hanging):
    """From its shape through its opposite, and back; about the place where it was taken."""
    at = np.array([0.0, -0.5, -np.pi / 2, 0.0, -1.5, -np.pi / 2])
    modes = rj.modes(hanging, at, t=0.2)
    assert modes.t == 0.2
    swinging = rj.animate(hanging, modes)
    assert len(swinging.models) == len(modes.frequencies) == 2
    hertz = np.asarray(modes.frequencies)[0] / (2 * np.pi)
    assert swinging.models[0].name == f"mode 1: {hertz:.4g} Hz"
    points = swinging.models[0].actual[1].points
    np.testing.assert_allclose(points[0], points[-1], atol=IDENTITY)
    (bar,) = (o for o in outlines(zoo.bars(), 0.0, at[None]) if o.part == "bar2")
    np.testing.assert_allclose(
        np.mean(points[[0, 30]], axis=(0, 1)), np.mean(bar.points[0], axis=0), atol=1e-2
    )
    assert np.ptp(points[:, :, 0]) > 0.3
    assert data(swinging.html())["alternatives"]


def test_each_mode_of_a_basis_swings(hanging, falling):
    """About its offset, one at a time, each named by its share of the first."""
    basis = rj.pod(falling, rank=2)
    swinging = rj.animate(hanging, basis)
    names = [model.name for model in swinging.models]
    share = float(basis.values[1] / basis.values[0])
    assert names == ["mode 1", f"mode 2: {share:.2g} of the first"]
    points = swinging.models[0].actual[1].points
    np.testing.assert_allclose(points[0], points[-1], atol=IDENTITY)
    assert np.ptp(points, axis=0).max() > 0.1
    # Over the bars as they hang.
    (still,) = (o for o in swinging.models[0].actual if o.style == "surface" and o.part == "bar2")
    (bar,) = (
        o for o in outlines(zoo.bars(), 0.0, np.asarray(basis.offset)[None]) if o.part == "bar2"
    )
    np.testing.assert_allclose(still.points, np.tile(bar.points, (61, 1, 1)), atol=IDENTITY)
    assert data(swinging.html())["alternatives"]


def test_a_run_that_breaks_off_is_drawn_to_its_end(scene, run):
    q = np.array(run.q)
    q[11:] = np.nan
    broken = dataclasses.replace(run, q=jnp.asarray(q))
    (model,) = rj.animate(scene, broken).models
    assert model.name == "(until 0.5 s)"
    assert all(np.all(np.isfinite(o.points)) for o in model.actual)
    np.testing.assert_array_equal(model.actual[0].points[10], model.actual[0].points[20])
    with pytest.raises(rj.InputError, match="no frame with finite coordinates"):
        rj.animate(scene, dataclasses.replace(run, q=jnp.asarray(q * np.nan)))


@pytest.mark.instant
def test_space_is_drawn_by_the_same_page(tmp_path):
    """Of outlines with three coordinates, seen from where one asks; films are a projection."""
    t = np.linspace(0.0, 1.0, 20)
    points = np.stack([np.cos(t), np.sin(t), t], axis=1)[:, None] * np.array([1.0, 2.0])[:, None]
    helix = [MovingOutline("top", points, "body", False)]
    space = rj.Animation(t, [Model("", helix, [])], Clock("t", "s", 1.0), view=(0.0, 0.5))
    told = data(space.html())
    assert told["dimension"] == 3
    assert apart(decoded(told, 0), helix) <= PIXELS
    assert told["view"] == [0.0, 0.5]
    with Image.open(space.save(tmp_path / "space.gif", fps=10, seconds=0.3)) as picture:
        assert picture.n_frames == 3


# Files.


def test_files(moving, tmp_path):
    page = moving.save(tmp_path / "x.html")
    assert page.read_text("utf-8") == moving.html(playing=True)
    with Image.open(moving.save(str(tmp_path / "x.GIF"), fps=10, seconds=0.5)) as picture:
        assert (picture.n_frames, picture.info["duration"]) == (5, 100)
        assert max(picture.size) > 700
    film = moving.save(tmp_path / "x.mp4", fps=10, seconds=0.5).read_bytes()
    assert film[4:8] == b"ftyp"


def test_a_film_names_what_it_needs(moving, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(rj.InputError, match=r"pip install 'romjax\[video\]'"):
        moving.save(tmp_path / "x.mp4")
    assert not (tmp_path / "x.mp4").exists()


def test_a_report_has_its_tables_where_its_film_fails(falling, tmp_path, monkeypatch):
    """As where the process that makes the film is ended."""

    def begin(*_, **__):
        def film():
            raise ChildProcessError("ended")

        return film

    monkeypatch.setattr(report, "_page", lambda *_: "")
    result = types.SimpleNamespace(truth=falling, rows=[], runs=[])
    study, example = types.SimpleNamespace(bases={}), types.SimpleNamespace(name="bars")
    drawn = report.draw(result, zoo.bars(), example, True, begin)
    (tmp_path / "report.html").write_text("of an older run")
    with pytest.raises(ChildProcessError, match="ended"):
        report.write(result, study, zoo.bars(), example, tmp_path, drawn, {})
    found = {path.name for path in tmp_path.iterdir()}
    assert found == {"report.html", "responses.png", "trajectory_full.csv"}
    assert not (tmp_path / "report.html").read_text()


# What does not fit.


def test_saving_refuses(moving, tmp_path):
    with pytest.raises(rj.InputError, match=r"'.*x.avi', but it must end in .html, .gif, .mp4"):
        moving.save(tmp_path / "x.avi")
    with pytest.raises(rj.InputError, match="fps=0 and seconds=None must be positive"):
        moving.save(tmp_path / "x.gif", fps=0)
    assert not list(tmp_path.iterdir())


def test_runs_refuse(scene, run, hanging, falling):
    batch = jax.tree.map(lambda x: jnp.asarray(np.stack([x, x])), run)
    wrong = {
        r"the run has other coordinates than the scene, cart.x: .*\(bar1, bar2\)": (hanging, run),
        r"take one motion out of a batch": (scene, batch),
        r"modes are drawn by themselves": (zoo.bars(), rj.modes(hanging, v=np.zeros(6))),
        r"a basis is drawn by itself": (zoo.bars(), rj.pod(falling, rank=2), falling),
        r"the basis is of 6 coordinates, but the bodies": (scene, rj.pod(falling, rank=2)),
    }
    for message, given in wrong.items():
        with pytest.raises(rj.InputError, match=message):
            rj.animate(*given)
    for given in ((scene, 3), (3, run)):
        with pytest.raises((rj.InputError, TypeError)):
            rj.animate(*given)
    with pytest.raises(rj.InputError, match=r"does not know.* by romjax.animate\(scene, run\)"):
        run.animate()
    assert run._repr_html_() is None
    with pytest.raises(rj.InputError, match="labels are .* for 1 runs"):
        rj.animate(scene, run, labels=["a", "b"])
    with pytest.raises(rj.InputError, match="resultant is 'torque', but in the plane must be one"):
        rj.animate(hanging, falling, resultant="torque")
    with pytest.raises(rj.InputError, match="resultant is 'moment'.* bodies are of RigidBody"):
        rj.animate(hanging, falling, resultant="moment")
    with pytest.raises(rj.InputError, match="resultants are those of runs"):
        rj.animate(hanging, rj.modes(hanging, v=np.zeros(6)), resultant="moment")
    with pytest.raises(rj.InputError, match="deformation is -1"):
        rj.animate(scene, run, deformation=-1)
    with pytest.raises(rj.InputError, match=r"no body 'bar1'. .*cart, beam"):
        rj.animate(scene, run, trace=rj.gallery.chain(1).bodies[0].at())
    with pytest.raises(rj.InputError, match="on the ground has no path"):
        rj.animate(scene, run, trace=rj.ground.at())
    with pytest.raises(rj.InputError, match="has coordinates, but no bodies"):
        rj.animate(zoo.oscillator())
