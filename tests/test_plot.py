"""Figures: that they show the data, where the parts of a mechanism are, what they refuse."""

import dataclasses
import io

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from at_rest import clamped_beam, frequencies_and_shapes
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from motions import cart_and_beam, motion, through
from PIL import Image
from tolerances import IDENTITY

import romjax as rj
from romjax import plot
from romjax.integrate.error_bar import ErrorBar
from romjax.scene.coordinate import Coordinate


@pytest.fixture(scope="module")
def scene() -> rj.Scene:
    return cart_and_beam()


@pytest.fixture(scope="module")
def truth(scene) -> rj.Trajectory:
    return motion(scene)


@pytest.fixture(scope="module")
def approx(scene) -> rj.Trajectory:
    return motion(scene, 0.11)


def panels(figure: Figure) -> list[Axes]:
    """The axes with lines in them."""
    return [axes for axes in figure.axes if axes.lines]


def data(line: Line2D) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_response_draws_the_moving_coordinates(truth, approx):
    figure = plot.response(truth, approx, labels=["full", "POD"])
    shown = panels(figure)
    moving = [i for i in range(truth.q.shape[1]) if i != 2]
    assert len(shown) == len(moving)
    for axes, place in zip(shown, moving, strict=True):
        for line, run, name in zip(axes.lines, (truth, approx), ("full", "POD"), strict=True):
            t, q = data(line)
            np.testing.assert_array_equal(t, truth.t)
            np.testing.assert_array_equal(q, np.asarray(run.q)[:, place])
            assert line.get_label() == name
    styles = {(line.get_color(), line.get_linestyle()) for line in shown[0].lines}
    assert len(styles) == 2
    units = [axes.get_ylabel().split("[")[1] for axes in shown]
    assert units == ["m]", "m]", "m]", "m]", "rad]", "kg$^{1/2}$ m]", "kg$^{1/2}$ m]"]


def test_response_draws_the_bar_of_a_run_as_a_band(truth, approx):
    """As wide on both sides as the corrected run is away."""
    corrected = dataclasses.replace(truth, bar=ErrorBar(np.asarray(0.01), "local, 2 modes"))
    (axes,) = panels(plot.response(corrected, approx, coordinates=["cart.x"]))
    assert [line.get_label() for line in axes.lines] == ["corrected", "approximation"]
    (band,) = axes.collections
    edges = band.get_paths()[0].vertices
    own, right = (np.asarray(run["cart.x"]) for run in (approx, truth))
    assert abs(edges[:, 1].max() - np.max(own + abs(right - own))) <= IDENTITY
    assert abs(edges[:, 1].min() - np.min(own - abs(right - own))) <= IDENTITY


def test_response_of_named_coordinates(truth):
    figure = plot.response(truth, coordinates=["beam.q1", "cart.phi"])
    assert [axes.get_ylabel() for axes in panels(figure)] == [
        "beam\n$q_{1}$ [kg$^{1/2}$ m]",
        "cart\n$\\varphi$ [rad]",
    ]


def test_response_of_a_custom_system_has_no_units(truth):
    unnamed = tuple(Coordinate("", f"q{i + 1}") for i in range(len(truth.labels)))
    own = dataclasses.replace(truth, coordinates=unnamed)
    assert panels(plot.response(own))[0].get_ylabel() == "q1"


def oscillator(name="x") -> rj.LinearModel:
    """Of x'' + 0.2 x' + 4 x = u, x and x' are given out."""
    a, b = np.array([[0.0, 1.0], [-4.0, -0.2]]), np.array([[0.0], [1.0]])
    names = ("z", "z'"), ("u",), (name, f"{name}'")
    return rj.LinearModel(a, b, np.eye(2), np.zeros((2, 1)), np.eye(1), *names)


def test_bode_shows_magnitude_and_phase():
    omega = np.array([0.5, 2.0, 8.0])
    size, phase = panels(plot.bode(oscillator(), omega=omega))
    wanted = 1 / (4 - omega**2 + 0.2j * omega)
    for axes, values in (
        (size, 20 * np.log10(np.abs(wanted))),
        (phase, np.angle(wanted, deg=True)),
    ):
        at, found = data(axes.lines[0])
        np.testing.assert_array_equal(at, omega)
        np.testing.assert_allclose(found, values, rtol=IDENTITY)
    assert [line.get_label() for line in size.lines] == ["x", "x'"]
    whole = data(panels(plot.bode(oscillator()))[0].lines[0])[0]
    np.testing.assert_allclose(whole[[0, -1]], [0.2, 20.0], rtol=IDENTITY)


@pytest.mark.instant
def test_bode_refuses_what_it_cannot_draw():
    for arguments, settings, words in (
        ((), {}, "no model"),
        ((oscillator(), oscillator("y")), {}, "linearize both with the same"),
        ((oscillator(),), {"labels": ["a", "b"]}, "2 labels for 1 models"),
        ((oscillator(),), {"omega": [0.0, 1.0]}, "must be positive"),
    ):
        with pytest.raises(ValueError, match=words):
            plot.bode(*arguments, **settings)


def test_response_shows_the_largest_of_many():
    many = motion(rj.gallery.chain(4))
    figure = plot.response(many)
    shown = panels(figure)
    assert len(shown) == 8
    # √M_ii |amplitude|: √(i+1) / (i+1) falls, so the first ones count, without the one at rest.
    np.testing.assert_array_equal(
        [data(axes.lines[0])[1] for axes in shown], np.asarray(many.q).T[[0, 1, 3, 4, 5, 6, 7, 8]]
    )
    assert "8 of 11" in figure.get_suptitle()


def test_errors_are_those_of_compare(truth, approx):
    figure = plot.errors(truth, {"POD": approx})
    report = rj.compare(truth, approx)
    shown = panels(figure)
    assert len(shown) == np.sum(np.asarray(report.moving))
    for axes, place in zip(shown, np.flatnonzero(report.moving), strict=True):
        assert axes.get_yscale() == "log"
        size = np.abs(np.asarray(report.history)[:, place])
        _, drawn = data(axes.lines[0])
        np.testing.assert_array_equal(drawn, np.where(size > 0, size, np.nan))
        assert axes.lines[0].get_label() == f"POD: {float(report.error):.1e}"


def test_notebooks_show_figures_without_pyplot(truth, approx):
    """As a picture, by themselves: the last line of a cell is enough."""
    one = {"coordinates": ["cart.x"]}
    for figure in (plot.response(truth, **one), plot.errors(truth, {"near": approx}, **one)):
        with Image.open(io.BytesIO(figure._repr_png_())) as picture:
            assert picture.format == "PNG"
            assert picture.width > 500


def test_values_show_what_decided_the_rank(truth):
    """The tolerance as a level line where one was given, the noise floor where there is one."""
    plain, asked = rj.pod(truth, rank=2), rj.pod(truth, tol=1e-3)
    texts = [[t.get_text() for t in plot.values(b).axes[0].texts] for b in (plain, asked)]
    assert texts == [["noise floor"], ["noise floor", "tolerance"]]
    levels = [line.get_ydata()[0] for line in plot.values(asked).axes[0].get_lines()]
    assert 1e-3 in levels
    assert float(asked.floor) in levels


def test_values_relative_to_the_largest_with_the_rank():
    spectrum = jnp.array([4.0, 1.0, 0.5, 0.0])
    pod = dataclasses.replace(
        rj.Basis.from_modes(np.eye(4)[:, :2], np.zeros(4)),
        spectrum=spectrum, values=spectrum, decomposition=rj.POD(),
    )  # fmt: skip
    sod = dataclasses.replace(pod, values=jnp.array([0.3, 0.1]), decomposition=rj.SOD())
    figure = plot.values(pod)
    (axes,) = panels(figure)
    kept, _, dropped, rank = axes.lines
    np.testing.assert_array_equal(data(kept)[1], [1.0, 0.25])
    np.testing.assert_array_equal(data(dropped)[0], [3, 4])
    assert data(dropped)[1][0] == 0.125
    assert 0 < data(dropped)[1][1] < np.finfo(float).eps
    assert (kept.get_markerfacecolor(), dropped.get_markerfacecolor()) != ("white", "white")
    assert dropped.get_markerfacecolor() == "white"
    assert data(rank)[0][0] == 2.5
    _, smooth = panels(plot.values(pod, sod))
    np.testing.assert_array_equal(data(smooth.lines[0])[1], [0.3, 0.1])


def test_modes_have_a_picture_each_and_a_table(scene):
    system = rj.assemble(scene)
    vectors = np.eye(system.n)[:, [0, 5, 6]]
    basis = rj.Basis.from_modes(vectors, system.q0)
    for figure in (plot.modes(scene, basis), plot.modes(scene, basis, system)):
        *pictures, below = figure.axes
        assert len(pictures) == 3
        (table,) = below.tables
        cells = table.get_celld()
        assert cells[1, 0].get_text().get_text() == "1"
        assert cells[1, 1].get_text().get_text() == "0"
        assert cells[6, -1].get_text().get_text() == "beam $\\varphi$"
        assert len(cells) == 3 + 4 * system.n
    # The bodies at rest are the first line; they have one of as many points that is displaced.
    rest, *others = (line.get_xydata() for line in pictures[0].lines)
    (moved,) = (line for line in others if line.shape == rest.shape)
    size = np.linalg.norm(np.nanmax(rest, axis=0) - np.nanmin(rest, axis=0))
    cart = slice(0, 5)
    np.testing.assert_allclose(moved[cart, 0] - rest[cart, 0], 0.15 * size, rtol=1e-6)
    np.testing.assert_allclose(moved[cart, 1], rest[cart, 1], atol=IDENTITY)


def test_modes_of_a_controlled_scene_have_rows_of_its_bodies():
    """None of the controller's states, which move nothing."""
    bar = rj.Beam("bar", mass=1.0, length=1.0)
    hinge = rj.Revolute(bar.at("start"), rj.ground.at(), name="hinge")
    gains = {"target": rj.Constant(0.0), "proportional": 1.0, "integral": 1.0}
    control = rj.PID(bar.at(), rj.ground.at(), **gains)
    basis = rj.Basis.from_modes(np.eye(4)[:, 2:], np.zeros(4))
    figure = plot.modes(rj.Scene([bar], [hinge], [control]), basis)
    (table,) = figure.axes[-1].tables
    assert len(table.get_celld()) == 2 + 3 * 3
    figure.draw_without_rendering()


def test_modes_of_a_large_scene_have_no_table():
    scene = rj.gallery.chain(9)
    n = rj.assemble(scene).n
    figure = plot.modes(scene, rj.Basis.from_modes(np.eye(n), np.zeros(n)))
    assert len(figure.axes) == 8
    assert "first 8 of 27" in figure.get_suptitle()


def test_figures_refuse_what_does_not_fit(scene, truth, approx):
    other = motion(rj.gallery.chain(2))
    late = dataclasses.replace(approx, t=jnp.asarray(np.asarray(approx.t) + 1))
    batch = jax.tree.map(lambda x: jnp.asarray(np.stack([x, x])), truth)
    basis = rj.Basis.from_modes(np.eye(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"'approximation' has 6 coordinates, but the truth has 8"):
        plot.response(truth, other)
    with pytest.raises(ValueError, match="1 labels for 2 motions"):
        plot.response(truth, approx, labels=["full"])
    with pytest.raises(ValueError, match=r"no coordinate 'beam.q9'; the motion has: cart.x"):
        plot.response(truth, coordinates=["beam.q9"])
    with pytest.raises(ValueError, match="out of a batch"):
        plot.response(batch)
    with pytest.raises(ValueError, match=r"'late' has 21 times from 1 s to 2 s, but the truth"):
        plot.errors(truth, {"late": late})
    with pytest.raises(ValueError, match="no motions to compare"):
        plot.errors(truth, {})
    with pytest.raises(ValueError, match="no basis given"):
        plot.values()
    with pytest.raises(ValueError, match="q has 3 coordinates, but the bodies of the scene"):
        plot.modes(scene, basis)
    with pytest.raises(ValueError, match="give the full system"):
        plot.modes(scene, basis, rj.assemble(scene))


def test_figures_refuse_what_is_of_another_kind(scene, truth):
    given = {
        "response": (scene,),
        "errors": (truth, truth),
        "values": (truth,),
        "modes": (truth, rj.Basis.from_modes(np.eye(3), np.zeros(3))),
        "loads": (rj.assemble(scene), [truth]),
        "configuration": (truth,),
        "reduction": (truth,),
        "reductions": (truth,),
        "accuracy": (truth,),
        "tuning": (truth,),
    }
    for name, arguments in given.items():
        words = f"{name}: .* is of type (Scene|Trajectory|list); give "
        with pytest.raises(rj.InputError, match=words):
            getattr(plot, name)(*arguments)


def test_a_configuration_is_where_its_coordinates_are(scene, truth):
    """Of a cart and a beam: at the start, and moved by as much as the coordinates say, or the start
    of the system, whose coordinates may be fewer.
    """
    system = rj.assemble(scene)
    moved = np.asarray(system.q0) + np.array([0.5, 0.25, *[0.0] * (system.n - 2)])
    first, second = (
        panels(plot.configuration(system, q))[0].lines[0].get_xydata() for q in (None, moved)
    )
    cart = slice(0, 5)
    np.testing.assert_allclose(second[cart] - first[cart], [[0.5, 0.25]] * 5, atol=IDENTITY)
    begun = dataclasses.replace(system, q0=jnp.asarray(moved))
    one = plot.configuration(begun).axes[0].lines[0].get_xydata()
    np.testing.assert_array_equal(one, second)
    with pytest.raises(rj.InputError, match="configuration: q is .*finite"):
        plot.configuration(scene, np.nan * moved)
    for wrong, words in (
        ("here", "is of type str; give the coordinates of one"),
        (truth, "is of type Trajectory; give the coordinates of one"),
        (moved[:3], rf"has shape \(3,\), but .* have \({system.n},\); give one position"),
    ):
        with pytest.raises(rj.InputError, match=f"configuration: q {words}"):
            plot.configuration(scene, wrong)
    with pytest.raises(rj.InputError, match=r"axes is of type int; give axes of matplotlib"):
        plot.configuration(scene, axes=3)


def test_a_configuration_of_a_reduced_system():
    """Its start, or its own coordinates as given: the first is the travel along the rail."""
    rom = rj.reduce(rj.assemble(rj.gallery.cart_pendulum()), formulation="joint")
    at, shift = np.asarray(rom.q0), np.eye(rom.n)[0]
    begun = dataclasses.replace(rom, q0=jnp.asarray(at + 0.1 * shift))
    first, *others = (
        panels(plot.configuration(system, q))[0].lines[0].get_xydata()[:5]
        for system, q in ((rom, rom.full.q0), (begun, None), (begun, at + 0.3 * shift))
    )
    for moved, by in zip(others, (0.1, 0.3), strict=True):
        np.testing.assert_allclose(np.linalg.norm(moved - first, axis=1), by, atol=IDENTITY)
    with pytest.raises(rj.InputError, match=r"\(1,\), but .*, and those of the reduced system \("):
        plot.configuration(rom, np.zeros(1))


@pytest.mark.instant
def test_the_package_of_figures_hands_out_functions_only():
    assert all(callable(getattr(plot, name)) for name in plot._FIGURES)
    assert set(plot._FIGURES) <= set(dir(plot))
    with pytest.raises(AttributeError, match="has no attribute 'figure'"):
        plot.figure  # noqa: B018


# Loads.


def test_loads_of_a_clamped_beam():
    """Under a force across its tip: the moment falls along it, and the weld carries the force."""
    numbers = {"mass": 1.0, "length": 2.0, "EI": 1e4}
    frequencies, tip = frequencies_and_shapes(**numbers, place=1.0)
    bent = tip * 2.0 / frequencies**2
    system = rj.assemble(clamped_beam(**numbers, push=2.0, amplitudes=bent))
    run = through(system)
    figure = plot.loads(system, run)
    (coloured,) = figure.axes[0].collections
    moments = np.asarray(coloured.get_array())
    places = np.linspace(0.0, 2.0, len(moments) + 1)
    # In the deformed configuration, which is shorter by the square of a deflection of 0.5 mm.
    np.testing.assert_allclose(moments, 2.0 * (2.0 - (places[1:] + places[:-1]) / 2), atol=1e-6)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert "2 N" in texts
    # As a twenty-fifth of 2 m they would be 150 times as large; a round number is below.
    assert figure.axes[0].get_title().endswith("deformation × 100")
    bare = plot.loads(system, run, quantity="shear", forces=False, deformation=1.0)
    assert bare.axes[0].get_title() == "t = 0 s"
    assert not bare.axes[0].texts
    assert not plot.loads(system, run, bodies=[]).axes[0].collections
    with pytest.raises(rj.InputError, match="no beam or rod 'bean'. Did you mean 'beam'"):
        plot.loads(system, run, bodies="bean")
    with pytest.raises(rj.InputError, match=r"moment .* of 'beam' is not finite at t = 0 s"):
        plot.loads(system, dataclasses.replace(run, q=np.nan * run.q))


@pytest.mark.instant
def test_loads_refuses_other_quantities():
    with pytest.raises(
        rj.InputError, match="quantity is 'torque', but in the plane must be one of"
    ):
        plot.loads(None, None, quantity="torque")
