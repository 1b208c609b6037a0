"""Scenes with one part changed: bodies replaced, made flexible, and taken out."""

import jax
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial as r
from romjax.linalg import quaternions
from romjax.scene.placing import marker_start

GALLERY = rj.gallery.ROBOTS


def poses(scene):
    """Where all markers are at the start, and how they are turned."""
    bodies = {body.name: body for body in scene.bodies}
    for part in (*scene.joints, *scene.effects):
        for marker in getattr(part, "markers", ()):
            pose = marker_start(bodies, marker)
            turn = np.asarray(pose.turn)
            yield np.asarray(pose.position), quaternions.matrix(turn) if turn.ndim else turn


def assert_markers_stay(before, after):
    for (one, turned), (other, as_before) in zip(poses(before), poses(after), strict=True):
        assert_close(other, one, IDENTITY)
        assert_close(as_before, turned, IDENTITY)


@pytest.fixture(scope="module")
def arm():
    pytest.importorskip("mujoco")
    return rj.load_scene(GALLERY / "arm.xml", start="home")


def crank():
    """Two plane bars, the second off the middle of what its joints hold."""
    points = {"pin": (0.3, 0.1), "foot": (-0.3, -0.1)}
    bar = rj.RigidBody("bar", 2.0, 0.1, (0.4, 0.2), 0.3, angular_velocity=2.0, points=points)
    rod = rj.RigidBody("rod", 1.0, 0.1, angle=0.5).placed((-0.2, 0.0), bar.pose("pin"))
    joints = [
        rj.Revolute(bar.at("foot"), rj.ground.at(bar.pose("foot").position)),
        rj.Revolute(rod.at((-0.2, 0.0)), bar.at("pin"), name="elbow"),
    ]
    return rj.Scene([bar, rod], joints, [rj.Gravity(), rj.Spring(rod.at(), rj.ground.at(), 10.0)])


def test_markers_stay_where_they_were(arm):
    with pytest.warns(UserWarning, match="its centre moves by .* moment of inertia was"):
        flexible = arm.flexible("forearm", EI=(800.0, 600.0), modes=2, GJ=300.0)
    beam = flexible.bodies[2]
    assert isinstance(beam, r.Beam)
    assert (float(beam.length), beam.bending, beam.torsion) == (0.35, (2, 2), 2)
    assert float(beam.mass) == float(arm.bodies[2].mass)
    assert_markers_stay(arm, flexible)
    with pytest.warns(UserWarning, match="body 'bar' is kept"):
        plane = crank().flexible("bar", EI=50.0)
    assert_markers_stay(crank(), plane)
    assert plane.bodies[0].modes == 3
    pins = [x.bodies[0].pose("pin").position for x in (plane, crank())]
    assert_close(*pins, IDENTITY)


def test_a_section_and_a_material_make_the_link_anew(arm):
    tube = rj.sections.Tube(0.07, 0.004)
    flexible = arm.flexible("forearm", section=tube, density=2700.0, modulus=70e9)
    beam = flexible.bodies[2]
    assert_close(beam.mass, 2700 * tube.area * beam.length, IDENTITY)


def test_what_is_held_beyond_the_ends_is_refused(arm):
    with pytest.raises(rj.SceneError, match=r"'roll' is 0.1\d+ m beyond the ends of the beam"):
        arm.flexible("forearm", EI=800.0, ends=("origin", arm.bodies[2].com))


@pytest.mark.instant
def test_names_and_bodies_that_do_not_suit(arm):
    with pytest.raises(rj.SceneError, match="flexible: there is no body 'fore'.*forearm"):
        arm.flexible("fore", EI=1.0)
    with pytest.raises(rj.SceneError, match="EI is missing; give the bending stiffness"):
        arm.flexible("forearm")
    with pytest.raises(rj.SceneError, match="it is a Beam, but only rigid bodies become beams"):
        rj.gallery.cart_pendulum().flexible("pendulum", EI=1.0)
    with pytest.raises(rj.SceneError, match="without: there is no part 'hinge'"):
        arm.without("hinge")
    with pytest.raises(rj.SceneError, match="has 3 dimensions, but the new one has 2"):
        arm.replace("forearm", rj.RigidBody("bar", 1.0, 1.0))


@pytest.mark.instant
def test_bodies_are_replaced():
    """A body with other axes in another place of the same link."""
    scene = crank()
    old = scene.bodies[0]
    new = rj.RigidBody("lever", 1.0, 0.1, (0.5, 0.1), angle=-0.7)
    changed = scene.replace("bar", new)
    assert [body.name for body in changed.bodies] == ["lever", "rod"]
    assert_markers_stay(scene, changed)
    assert_markers_stay(scene, changed.replace("lever", old))


@pytest.mark.instant
def test_parts_are_taken_out():
    scene = crank()
    alone = scene.without("rod")
    assert [len(x) for x in (alone.bodies, alone.joints, alone.effects)] == [1, 1, 1]
    free = scene.without("elbow", "Spring(rod, ground)")
    assert [len(x) for x in (free.bodies, free.joints, free.effects)] == [2, 1, 1]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:flexible")
def test_an_elastic_link_is_differentiable(arm):
    """Its accelerations, as it is bent a little, are linear in the stiffness; joints hold at
    first.
    """

    def rates(stiffness, bent):
        system = rj.assemble(arm.flexible("forearm", EI=stiffness, modes=2))
        modal = ~np.array(system.structure.rigid)
        acceleration, _ = system.acceleration(0.0, system.q0 + bent * modal, system.v0)
        return acceleration, system.constraint(0.0, system.q0)

    both = jax.jit(lambda x: jax.jvp(lambda x: rates(x, 1e-4), (x,), (1.0,)))
    (found, violation), (slope, _) = both(800.0)
    (other, _), _ = both(900.0)
    assert_close(violation, 0 * violation, IDENTITY)
    assert np.max(np.abs(slope)) > 1e-6
    assert_close((other - found) / 100, slope, SOLVED, np.max(np.abs(slope)))
