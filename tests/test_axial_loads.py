"""What linear bodies leave out, axial loads of beams and large turns of meshes, and who tells."""

import meshes
import numpy as np
import pytest
import zoo
from comparison import assert_close
from programs import kept
from tolerances import SOLVED
from verification_problems.far import ELASTICA

import romjax as rj
from romjax import spatial
from romjax.assembly.axial_loads import axial_loads
from romjax.assembly.linear_bodies import FAR, turning_warning

LENGTH, MASS, EI = 2.0, 3.0, 100.0
Z = (0.0, 0.0, 1.0)


def column(load, **options):
    """A column along x, hinged at its start and guided at its end, under a load per EI / L²."""
    bending = {"EI": EI, "modes": 2, **options}
    beam = rj.Beam("column", MASS, LENGTH, position=(LENGTH / 2, 0.0), **bending)
    joints = [
        rj.Revolute(beam.at("start"), rj.ground.at()),
        rj.PointOnLine(beam.at("end"), rj.ground.at()),
    ]
    push = rj.Force(beam.at("end"), (-1.0, 0.0), rj.Constant(load * EI / LENGTH**2))
    return rj.assemble(rj.Scene([beam], joints, [push]))


def turning(spin):
    """A bar in space that swings in its stiffer plane through the lowest point."""
    beam = spatial.Beam(
        "hanging",
        MASS,
        LENGTH,
        (1e-2, 1.0, 1.0),
        EI=(EI, 2 * EI),
        bending=(2, 0),
        position=(0.0, -LENGTH / 2, 0.0),
        orientation=spatial.rotation(Z, -np.pi / 2),
        velocity=(spin * LENGTH / 2, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, spin),
    )
    hinge = spatial.Revolute(beam.at("start", axis=Z), rj.ground.at((0.0, 0.0, 0.0), axis=Z))
    return rj.assemble(rj.Scene([beam], [hinge], [rj.Gravity((0.0, -zoo.GRAVITY, 0.0))]))


@kept
def at_start(system):
    return axial_loads(system, 0.0, system.q0, system.v0)


def test_mean_forces():
    """P of a column; half of the weight and m Ω² L / 3 of a beam that hangs and turns."""
    pressed, hung = column(0.5 * np.pi**2), turning(1.5)
    assert_close(at_start(pressed), [-0.5 * np.pi**2], SOLVED)
    mean = MASS * zoo.GRAVITY / 2 + MASS * 1.5**2 * LENGTH / 3
    assert_close(at_start(hung), [mean * LENGTH**2 / (2 * EI)], SOLVED)


def test_a_run_says_which_beam_is_compressed():
    pressed = column(0.5 * np.pi**2)
    run = zoo.run(pressed, np.linspace(0.0, 0.1, 3))
    words = run.warnings()
    assert words == (
        "beam 'column' is compressed by 4.9 EI/L², which does not soften its bending without "
        "stiffening; give it stiffening=True"
    )
    assert not zoo.run(column(0.05), np.linspace(0.0, 0.1, 3)).warnings()


@pytest.mark.slow
def test_modes_and_equilibria_warn():
    pulled = column(-2.0)
    with pytest.warns(UserWarning, match="equilibrium: beam 'column' is pulled by 2 EI/L²"):
        q = rj.equilibrium(pulled)
    with pytest.warns(UserWarning, match="modes: beam 'column' is pulled by 2 EI/L²"):
        rj.modes(pulled, q)
    # Silent, by the filters of the tests, where loads are small.
    rj.modes(column(0.09), q)


@pytest.mark.slow
def test_linear_models_warn():
    pulled = column(-2.0)
    with pytest.warns(UserWarning, match="linearize: beam 'column' is pulled by 2 EI/L²"):
        rj.linearize(pulled, {}, [])


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"stiffening": True}, {"EI": None, "frequencies": [8.0, 30.0]}]
)
def test_others_are_silent(options):
    """Beams that stiffen, and those whose EI nobody knows."""
    options = {"modes": None, **options} if "frequencies" in options else options
    rj.modes(column(1.0, **options))


def mesh(load=0.0):
    """A meshed cantilever of one metre and EI = 1 along x under a load across its end."""
    matrices = meshes.beam(8, 1.0, 1.0, 1e4, 1.0)
    ports = {"start": 0, "end": 8}
    body = rj.ModalBody.of_mesh("plate", *matrices, ports, modes=2)
    body = body.placed("start", rj.ground.pose((0.0, 0.0)))
    clamp = rj.Weld(body.at("start"), rj.ground.at((0.0, 0.0)))
    push = rj.Force(body.at("end"), (0.0, 1.0), rj.Constant(load))
    return rj.Scene([body], [clamp], [push])


def test_a_mesh_that_is_turned_far_against_its_frame():
    """By its largest turn at any point, in any of the states that are looked at."""
    system = rj.assemble(mesh())
    shapes = np.asarray(mesh().bodies[0].shapes)
    amplitude = FAR / np.max(np.abs(shapes[:, 2, 0]))
    q = np.zeros((3, system.n))
    for share, words in ((0.99, ""), (1.5, "mesh 'plate' is turned by 0.3 rad against its frame")):
        q[1, 3] = share * amplitude
        assert turning_warning(system, np.arange(3.0), q, 0 * q).partition(", to which")[0] == words


@pytest.mark.slow
def test_what_a_mesh_errs_by_that_bends_far():
    """At the load of the elastica that turns its end by 0.46 rad: some hundredths."""
    scene = mesh(load=1.0)
    with pytest.warns(UserWarning, match=r"equilibrium: mesh 'plate' is turned by 0\.33 rad"):
        q = rj.equilibrium(rj.assemble(scene))
    body = scene.bodies[0]
    x, y = np.asarray(body.started(q, np.zeros_like(q)).pose("end").position)
    _, deflection, shortening = ELASTICA[1.0]
    error = np.hypot(y - deflection, 1 - x - shortening)
    assert 0.02 < error / np.hypot(deflection, shortening) < 0.05
