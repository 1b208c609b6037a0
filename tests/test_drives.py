"""Drives whose offset is left out begin where the bodies are placed, in the plane and in space."""

import diffrax
import jax
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial

TILT, SPEED = 1.05, 9.0
TS = np.linspace(0.0, 0.5, 6)


def crank(signal, angle=TILT, spin=SPEED) -> rj.Scene:
    """A bar that a drive turns about its centre, between markers that are turned themselves."""
    bar = rj.RigidBody("crank", 1.0, 0.1, angle=angle, angular_velocity=spin)
    ends = bar.at((0.0, 0.0), 0.1), rj.ground.at((0.0, 0.0), 0.3)
    drive = rj.PrescribedAngle(*ends, signal, name="drive")
    return rj.Scene([bar], [rj.Revolute(*ends), drive])


def cart(signal) -> rj.Scene:
    """A body on a rail through the origin, a point of which is moved along it."""
    body = rj.RigidBody("cart", 1.0, 0.1, position=(0.3, 0.4), angle=0.2)
    drive = rj.PrescribedTravel(body.at((0.1, 0.0)), rj.ground.at((0.0, 0.0), 0.5), signal)
    return rj.Scene([body], [drive])


def tube(signal) -> rj.Scene:
    """A body in space that is turned about z, and moved along it."""
    turned = spatial.rotation((0.0, 0.0, 1.0), TILT)
    body = spatial.RigidBody("b", 1.0, (1.0, 1.0, 1.0), (0.1, 0.0, 0.7), turned)
    ends = body.at((0.0, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
    return rj.Scene(
        [body], [kind(*ends, signal) for kind in (rj.PrescribedAngle, rj.PrescribedTravel)]
    )


def link(signal, size=1.0) -> rj.Scene:
    """A body at the end of a line whose length is given."""
    body = rj.RigidBody("body", 1.0, 0.1 * size**2, position=(0.3 * size, 0.4 * size))
    return rj.Scene([body], [rj.PrescribedDistance(body.at(), rj.ground.at(), signal)])


def shortened(size) -> rj.AbstractSystem:
    """The link as its line is taken in within half a second, and then beyond nothing."""
    return rj.assemble(rj.consistent_scene(link(rj.Ramp(-size), size)))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_distance_that_comes_to_zero_fails(size):
    """It has no direction there, and nothing below zero; whatever the size of the mechanism."""
    with pytest.raises(rj.SimulationError, match="CONSTRAINTS_VIOLATED: not all joints hold"):
        zoo.run(shortened(size), [0.0, 0.5, 1.0])


@pytest.mark.slow
def test_a_compact_body_on_a_long_line_may_drift_as_steps_allow():
    """The mechanism is as large as the line, and not as its body."""
    body = rj.RigidBody("p", 1.0, 1e-8, position=(1.0, 0.0), velocity=(0.0, 10.0))
    scene = rj.Scene([body], [rj.Distance(body.at(), rj.ground.at(), 1.0)])
    coarse = {"solver": diffrax.Tsit5(), "dt": 0.05, "stabilization": rj.Baumgarte(10, 25)}
    run = zoo.run(rj.assemble(scene), np.linspace(0.0, 1.0, 11), **coarse)
    # More than what the size of the body allows.
    assert np.max(run.violation) > 2e-5


def begin(scene) -> list[float]:
    """The offsets of the drives, once the scene is assembled."""
    joints = [group.joints for group in rj.assemble(scene).joints]
    return [
        float(np.asarray(joint.signal.offset)[0]) for joint in joints if hasattr(joint, "signal")
    ]


def test_a_ramp_begins_where_the_bodies_are_placed():
    """At the angle between the markers, the way along the axis, and the distance."""
    way = np.cos(0.5) * (0.3 + 0.1 * np.cos(0.2)) + np.sin(0.5) * (0.4 + 0.1 * np.sin(0.2))
    assert_close(begin(crank(rj.Ramp(SPEED))), [TILT + 0.1 - 0.3], IDENTITY)
    assert_close(begin(cart(rj.Ramp(SPEED))), [way], IDENTITY)
    assert_close(begin(link(rj.Ramp(SPEED))), [0.5], IDENTITY)


def test_a_ramp_in_space_begins_there():
    """At the angle about the axis of the joint, and the way along it."""
    assert_close(begin(tube(rj.Ramp(SPEED))), [TILT, 0.7], IDENTITY)


@pytest.mark.instant
def test_an_offset_that_is_given_stays():
    for make in (crank, cart, tube, link):
        assert set(begin(make(rj.Ramp(SPEED, 0.0)))) == {0.0}
        assert set(begin(make(rj.Ramp(SPEED, 0.4)))) == {0.4}


@pytest.mark.parametrize("left", [rj.Ramp(SPEED), rj.Sum((rj.Ramp(2.0), rj.Ramp(SPEED - 2.0)))])
def test_a_sum_begins_there_too(left):
    """Whatever its other terms are at the start; the first of two ramps takes all of it."""
    signal = rj.Sum((rj.Sine(0.1, 2.0, phase=0.5), left))
    system = rj.assemble(crank(signal))
    assert_close(system.constraint(0.0, system.q0), np.zeros(3), IDENTITY)


def test_a_load_begins_at_zero():
    wheel = rj.RigidBody("wheel", 1.0, 0.5, angle=TILT)
    torque = rj.Torque(wheel.at(), rj.Ramp(3.0))
    system = rj.assemble(rj.Scene([wheel], [], [torque]))
    force = jax.jit(system.force)(2.0, system.q0, system.v0)
    assert_close(force, [0.0, 0.0, 6.0], IDENTITY)


def test_the_offset_follows_a_start_that_changes():
    """Traced, in a batch and in derivatives: it is that of the scene that is assembled."""

    def offset(angle):
        return rj.assemble(crank(rj.Ramp(SPEED), angle)).joints[-1].joints.signal.offset[0]

    angles = np.array([0.1, 2.0, 7.0])
    assert_close(rj.sweep(offset, angles).values, angles - 0.2, IDENTITY)
    assert_close(jax.grad(offset)(TILT), 1.0, IDENTITY)


DRIVEN = """\
format = 1

[bodies.wheel]
type = "RigidBody"
mass = 1.0
inertia = 0.1
angle_deg = 60.0

[joints]
axle = { type = "Revolute", a = "wheel", b = "ground" }

[joints.drive]
type = "PrescribedAngle"
a = "wheel"
b = "ground"
signal = { type = "Ramp", rate = 10.0 }
"""


def test_files_leave_an_offset_out_or_give_it(tmp_path):
    """In radians or degrees; what is left out stays so when the scene is written again."""
    path, again = tmp_path / "driven.toml", tmp_path / "again.toml"
    for given, wanted in (
        ("", np.pi / 3),
        (", offset = 0.5", 0.5),
        (", offset_deg = 90", np.pi / 2),
    ):
        path.write_text(DRIVEN.replace("10.0 }", f"10.0{given} }}"))
        scene = rj.load_scene(path)
        assert_close(begin(scene), [wanted], IDENTITY)
        scene.save(again)
        assert ("offset" in again.read_text()) == bool(given)
        assert_close(begin(rj.load_scene(again)), [wanted], IDENTITY)


@pytest.mark.instant
@pytest.mark.parametrize(
    "signal",
    [
        '{ type = "Ramp", rate = 1.0, offset_deg = 3 }',
        '{ type = "Sum", terms = [{ type = "Ramp", rate = 1.0, offset_deg = 3 }] }',
    ],
)
def test_files_refuse_degrees_of_what_is_no_angle(signal, tmp_path):
    """Of a travel and of a force."""
    travel = '[joints.drive]\ntype = "PrescribedTravel"\na = "wheel"\nb = "ground"\n'
    force = '[effects.push]\ntype = "Force"\nat = "wheel"\ndirection = [1, 0]\n'
    path, scene = tmp_path / "driven.toml", DRIVEN.split("[joints.drive]")[0]
    for part, unit in ((travel, "m"), (force, "N")):
        path.write_text(f"{scene}{part}signal = {signal}\n")
        with pytest.raises(rj.SceneFileError, match=f"signal is in {unit}, not an angle"):
            rj.load_scene(path)


def test_a_drive_moves_what_joints_hold_more_often_than_once():
    """Repeated rows are no reason to call the mechanism locked; a drive of a bar that is really
    held, at two places, is one.
    """
    scene = crank(rj.Ramp(SPEED))
    hinge, drive = scene.joints
    system = rj.assemble(rj.Scene(scene.bodies, [hinge, hinge, drive]))
    assert system.m > system.n
    run = zoo.run(system, TS)
    assert_close(run["crank.phi"], TILT + SPEED * TS, SOLVED, scale=SPEED)
    held = rj.Revolute(scene.bodies[0].at((0.5, 0.0)), rj.ground.at((0.25, 0.43)))
    with pytest.raises(rj.SceneError, match="leave no motion"):
        rj.assemble(rj.Scene(scene.bodies, [hinge, held, drive]))
