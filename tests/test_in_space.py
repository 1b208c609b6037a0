"""Planar mechanisms in space, at a random orientation of their plane."""

import numpy as np
import pytest
import zoo
from comparison import assert_close
from gallery_facts import IN_THE_PLANE
from groups import in_groups
from in_space import InSpace
from programs import kept
from tolerances import IDENTITY, SOLVED

import romjax as rj

TURN = np.random.default_rng(7).normal(size=4)
# Of accelerations, which joints pass on from body to body.
PASSED_ON = 1e3 * IDENTITY


def all_parts() -> rj.Scene:
    """Every joint and effect of the plane at once, at a start that fits."""
    hub = rj.RigidBody("hub", 2.0, 0.3, angular_velocity=1.5)
    rim = rj.RigidBody("rim", 1.0, 0.2, position=(0.9, 0.0), angle=4.0, angular_velocity=-3.0)
    cart = rj.RigidBody("cart", 1.5, 0.1, position=(-0.5, 0.4), velocity=(0.3, 0.0))
    bob = rj.RigidBody("bob", 0.7, 0.05, position=(-0.5, -0.2), angle=0.4, velocity=(0.3, 0.0))
    ring = rj.RigidBody("ring", 0.4, 0.03, position=(2.0, 0.5), angle=-0.3)
    plate = rj.RigidBody("plate", 0.4, 0.03, position=(2.0, 0.9), angle=1.5)
    crank = rj.RigidBody("crank", 0.4, 0.03, position=(3.0, 0.2), angle=0.3)
    joints = [
        rj.Revolute(hub.at(), rj.ground.at()),
        rj.Revolute(rim.at(), rj.ground.at((0.9, 0.0))),
        rj.Gear(rim.at(), hub.at(), ratio=-2.0, offset=4.0),
        rj.Prismatic(cart.at(), rj.ground.at((0.0, 0.4))),
        rj.Distance(bob.at(), cart.at(), length=0.6),
        rj.PointOnCurve(ring.at(), rj.ground.at((2.0, 0.0)), rj.Circle(0.5)),
        rj.FixedAngle(ring.at(), rj.ground.at(), value=-0.3),
        rj.PointOnLine(plate.at(), rj.ground.at((0.0, 0.9))),
        rj.Weld(crank.at(), rj.ground.at((3.0, 0.2)), value=0.3),
    ]
    effects = [
        rj.Gravity((0.3, -9.81)),
        rj.TorsionSpring(rim.at(), hub.at(), stiffness=0.4, rest_angle=0.2),
        rj.TorsionDamper(rim.at(angle=0.1), bob.at(), damping=0.3),
        rj.Motor(hub.at(), rj.ground.at(), rj.Sine(4.0, 0.4), proportional=1.0, derivative=0.2),
        rj.Bushing(plate.at((0.1, 0.0)), ring.at(), (3.0, 5.0, 0.4), (0.3, 0.5, 0.1)),
        rj.Spring(bob.at((0.1, 0.2)), hub.at((0.2, 0.0)), stiffness=3.0, rest_length=0.2),
        rj.Damper(bob.at((0.1, 0.2)), hub.at((0.2, 0.0)), damping=0.3, along_line=True),
        rj.Drag(bob.at((0.0, 0.1)), coefficient=1.1, area=0.3),
        rj.Force(bob.at((0.1, 0.1)), (1.0, 2.0), rj.Sine(2.0, 1.0), frame="body"),
        rj.Force(cart.at(), (1.0, 2.0), rj.Sine(2.0, 1.0)),
        rj.Torque(bob.at(), rj.Sine(0.3, 2.0, phase=0.4)),
        rj.Contact(
            plate.at((0.0, -0.2)),
            ring.at(),
            rj.Circle(0.25),
            stiffness=200.0,
            dissipation=0.2,
            friction=rj.Friction(0.3, creep=0.1),
        ),
    ]
    return rj.Scene([hub, rim, cart, bob, ring, plate, crank], joints, effects)


@kept
def apart() -> rj.Scene:
    """Two beams that bend on both sides of a block, with free ends and clamped at one, and a cart
    whose drives pull and turn it.
    """
    bent = {"EI": 30.0, "modes": 3, "damping": 0.02, "rates": (0.3, -0.1, 0.2)}
    first = rj.Beam("first", 1.2, 0.8, amplitudes=(0.01, -0.003, 0.001), **bent)
    first = first.placed("start", rj.ground.pose(), angle=0.4)
    block = rj.RigidBody("block", 0.5, 0.02).placed((0.0, 0.0), first.pose("end"))
    second = rj.Beam("second", 0.9, 0.6, axis="y", shapes="clamped-free", **bent)
    second = second.placed("start", block.pose((0.1, 0.0)))
    cart = rj.RigidBody("cart", 1.5, 0.1, velocity=(0.6, 0.0), angular_velocity=0.3 * 2 * np.pi)
    joints = [
        rj.Revolute(first.at("start"), rj.ground.at()),
        rj.Revolute(first.at("end"), block.at()),
        rj.Revolute(second.at("start"), block.at((0.1, 0.0))),
        rj.PrescribedTravel(cart.at(), rj.ground.at(), rj.Ramp(0.6)),
        rj.PrescribedAngle(cart.at(), rj.ground.at(), rj.Ramp(0.3 * 2 * np.pi)),
    ]
    effects = [
        rj.Gravity((0.3, -9.81)),
        rj.Spring(second.at("end"), rj.ground.at((1.0, 1.0)), stiffness=30.0, rest_length=0.3),
        # On a rigid body: a section that deflects by θ turns by 2 arctan(θ/2) in space.
        rj.TorsionDamper(block.at(), rj.ground.at(), damping=0.05),
        rj.Force(block.at((0.0, 0.1)), (0.0, 1.0), rj.Sine(4.0, 3.0), frame="body"),
    ]
    return rj.Scene([first, block, second, cart], joints, effects)


# Of the beams, joints are closed but for the velocities.
SCENES = {"all parts": all_parts, "beams": apart}
# But for the beam whose bending shortens it, and the rod: they have no twin of modes in space.
FLAT = {"rotating_blade", "uncoiling_strip"}
PLANAR = [name for fact in IN_THE_PLANE if (name := fact.__name__) not in FLAT]


@kept
def forces(system, t):
    """Accelerations and multipliers at the start."""
    return system.acceleration(t, system.q0, system.v0)


def assert_same_forces(scene: rj.Scene, t: float):
    """Accelerations and multipliers at the start of a scene and of its twin."""
    twin, planar = InSpace(scene, TURN), rj.assemble(scene)
    spatial = rj.assemble(twin.scene)
    a, multipliers = map(np.asarray, forces(planar, t))
    b, others = map(np.asarray, forces(spatial, t))
    found, out = twin.accelerations(spatial.q0, b)
    assert_close(found, a, PASSED_ON, 1 + np.max(np.abs(a)))
    assert out <= PASSED_ON * (1 + np.max(np.abs(a)))
    found = twin.multipliers(others, planar.q0)
    assert_close(found, multipliers, PASSED_ON, 1 + np.max(np.abs(multipliers), initial=0.0))


@pytest.mark.parametrize("name", in_groups(SCENES, fast=["beams"], slow=["all parts"]))
def test_every_part_of_the_plane_in_space(name):
    assert_same_forces(SCENES[name](), 0.13)


@pytest.mark.parametrize("name", in_groups(PLANAR, slow=["cart_pendulum"]))
def test_the_gallery_in_space(name):
    assert_same_forces(getattr(rj.gallery, name)(), 0.0)


@pytest.mark.slow
def test_moves_as_its_planar_twin():
    """Motion and multipliers of a pendulum, from runs of their own."""
    scene, ts = zoo.bar(mass=1.4, angle=0.3, spin=-2.0), np.linspace(0.0, 0.3, 6)
    twin = InSpace(scene, TURN)
    run = zoo.run(rj.assemble(scene), ts, rtol=1e-11)
    other = zoo.run(rj.assemble(twin.scene), ts, rtol=1e-11)
    q, found = np.asarray(run.q), twin.coordinates(other.q)
    turns = 2 * np.pi * np.round((found - q) / (2 * np.pi))
    turns[:, [not label.endswith("phi") for label in run.labels]] = 0
    assert_close(found - turns, q, SOLVED, 1 + np.max(np.abs(q)))
    multipliers, others = np.asarray(run.multipliers), np.asarray(other.multipliers)
    size = 1 + np.max(np.abs(multipliers))
    for own, wanted, values in zip(q, multipliers, others, strict=True):
        assert_close(twin.multipliers(values, own), wanted, SOLVED, size)
