"""Scenes in space by lot, from a seed: every kind of joint and effect there is in space.

Their joints need not hold: the identities that they are for are those of any state.
"""

from typing import Any

import numpy as np
from random_scenes import Lot, random_signal

import romjax as rj

r = rj.spatial
MOST_BODIES = 3
# Structures of the parts of machines; those that follow are of the parts that robots bring.
MACHINES = 10


def random_spatial_scene(seed: int, structure: int) -> rj.Scene:
    """One to three bodies on joints of a tree; scenes of one `structure` differ in numbers alone.

    Structures take turns through all kinds of joints and effects, so that none is left out.
    """
    lot = Lot(np.random.default_rng([2, structure]), np.random.default_rng([3, seed]))
    count = int(lot.kinds.integers(2, MOST_BODIES + 1))
    bodies = [random_body(lot, f"body{k}", beam=(structure + k) % 3 == 0) for k in range(count)]
    robot, turn = structure >= MACHINES, structure % MACHINES
    kinds, loads = (ROBOT_JOINTS, ROBOT_EFFECTS) if robot else (JOINTS, EFFECTS)
    joints = [
        kinds[(turn * 2 + k) % len(kinds)](lot, bodies[k], bodies[k - 1] if k else rj.ground)
        for k in range(2)
    ]
    effects = [loads[(turn * 3 + k) % len(loads)](lot, bodies) for k in range(3)]
    return rj.Scene(bodies, joints, effects)


def random_body(lot: Lot, name: str, beam: bool) -> rj.AbstractBody:
    start = {
        "position": lot.around(1.5, 3),
        "orientation": lot.around(1.0, 4),
        "velocity": lot.around(1.0, 3),
        "angular_velocity": lot.around(2.0, 3),
    }
    mass = lot.between(0.3, 3.0)
    if not beam:
        axes = np.linalg.qr(lot.around(1.0, (3, 3)))[0]
        moments = lot.between(0.2, 0.35, 3)
        return r.RigidBody(name, mass, axes @ np.diag(moments) @ axes.T, **start)
    return r.Beam(
        name,
        mass,
        lot.between(0.5, 1.2),
        (0.2, *lot.between(0.6, 0.75, 2)),
        EI=lot.between(2.0, 20.0, 2),
        bending=(1, 1),
        GJ=lot.between(2.0, 20.0),
        torsion=1,
        damping=lot.maybe(0.0, 0.1),
        stiffening=lot.chance(0.5),
        amplitudes=lot.around(0.03, 3),
        rates=lot.around(0.3, 3),
        **start,
    )


def random_marker(lot: Lot, on: Any) -> rj.Marker:
    """Turned in any way; of a beam an end, whose points are few."""
    turn = lot.around(1.0, 4)
    if isinstance(on, r.Beam):
        return on.at(lot.one_of(["start", "end"]), rotation=turn)
    return on.at(lot.around(0.5, 3), rotation=turn)


def ends(lot: Lot, *on: Any) -> list[rj.Marker]:
    return [random_marker(lot, x) for x in on]


def plain(kind: type) -> Any:
    return lambda lot, *on: kind(*ends(lot, *on))


def smooth(lot: Lot) -> rj.AbstractSignal:
    return random_signal(lot, 0.3, smooth=True)


def way(lot: Lot) -> rj.AbstractSignal:
    """Of a distance, which stays positive."""
    return rj.Sum((rj.Constant(1.0), smooth(lot)))


def curve(lot: Lot) -> Any:
    return lot.one_of([r.Helix(0.5, 0.3), r.SpacePolynomial(lot.around(0.5, (3, 2)))])


def motion(lot: Lot) -> str:
    return lot.one_of(["angle", "travel", "distance", "1 of 2"])


def surface(lot: Lot) -> r.AbstractSurface:
    size = lot.between(0.5, 1.5)
    return lot.one_of(
        [r.Plane(), r.Cylinder(size), r.Sphere(size, hollow=True), r.Capsule(size, 1.0)]
    )


def positive(lot: Lot) -> np.ndarray:
    root = lot.around(2.0, (6, 6))
    return root @ root.T


JOINTS = (
    plain(r.Revolute),
    plain(r.Spherical),
    plain(r.Universal),
    plain(r.Cylindrical),
    plain(r.Prismatic),
    plain(r.Planar),
    plain(r.Weld),
    plain(r.ConstantVelocity),
    plain(r.PointOnPlane),
    plain(rj.PointOnLine),
    lambda lot, a, b: r.Screw(*ends(lot, a, b), pitch=lot.between(0.1, 0.5)),
    # Gears at an odd number are between two bodies.
    lambda lot, a, b: r.Gear(*ends(lot, a, b, rj.ground, rj.ground), ratio=lot.between(-3, 3)),
    lambda lot, a, b: r.PointOnCurve(*ends(lot, a, b), curve(lot)),
    lambda lot, a, b: rj.Distance(*ends(lot, a, b), length=lot.between(0.5, 1.5)),
    lambda lot, a, b: rj.FixedAngle(*ends(lot, a, b), value=lot.around(1.0)),
    lambda lot, a, b: rj.PrescribedAngle(*ends(lot, a, b), smooth(lot)),
    lambda lot, a, b: rj.PrescribedTravel(*ends(lot, a, b), smooth(lot)),
    lambda lot, a, b: rj.PrescribedDistance(*ends(lot, a, b), way(lot)),
)

EFFECTS = (
    lambda lot, b: rj.Gravity(lot.around(10.0, 3)),
    lambda lot, b: rj.Spring(*ends(lot, b[0], b[1]), lot.between(1, 99), cubic=lot.maybe(0, 99)),
    lambda lot, b: rj.Damper(*ends(lot, b[0], b[1]), lot.between(0, 3), along_line=lot.chance(0.5)),
    lambda lot, b: rj.TorsionSpring(*ends(lot, b[1], rj.ground), lot.between(0, 9), lot.around(1)),
    lambda lot, b: rj.TorsionDamper(*ends(lot, b[0], b[1]), lot.between(0, 1)),
    lambda lot, b: r.Bushing(*ends(lot, b[0], b[1]), positive(lot), 0.1 * positive(lot)),
    lambda lot, b: rj.Force(
        random_marker(lot, b[0]),
        lot.around(1.0, 3),
        random_signal(lot, 9.0),
        frame=lot.one_of(["world", "body"]),
    ),
    lambda lot, b: r.Torque(
        random_marker(lot, b[1]),
        lot.around(1.0, 3),
        random_signal(lot, 3.0),
        frame=lot.one_of(["world", "body"]),
    ),
    lambda lot, b: rj.Drag(random_marker(lot, b[0]), lot.between(0.3, 1.2), lot.between(0.1, 1)),
    lambda lot, b: rj.Motor(
        *ends(lot, b[0], rj.ground), random_signal(lot, 1), lot.between(0, 9), lot.between(0, 1)
    ),
    lambda lot, b: r.Contact(
        *ends(lot, b[0], b[1]),
        surface(lot),
        lot.between(50, 500),
        dissipation=lot.maybe(0, 1),
        friction=rj.Friction(lot.between(0.1, 0.4), lot.between(0.05, 0.2)),
    ),
)

ROBOT_JOINTS = (
    plain(r.Untwisted),
    # As gears, couplings at an odd number are between two bodies.
    lambda lot, a, b: rj.Coupling(
        *ends(lot, a, b, rj.ground, rj.ground), lot.around(1.0, 2), motion_b="travel"
    ),
    plain(r.ParallelAxes),
    plain(r.RightAngle),
    lambda lot, a, b: r.RollingDisc(*ends(lot, a, b), lot.between(0.2, 0.5)),
    lambda lot, a, b: r.RollingBall(*ends(lot, a, b), lot.between(0.2, 0.5)),
)

ROBOT_EFFECTS = (
    lambda lot, b: rj.JointSpring(*ends(lot, b[0], b[1]), lot.between(0, 9), motion=motion(lot)),
    lambda lot, b: rj.JointDamper(
        *ends(lot, b[1], rj.ground), lot.between(0, 1), motion="any turn"
    ),
    lambda lot, b: rj.JointStop(
        *ends(lot, b[0], b[1]), -0.1, 0.1, 5.0, lot.between(0, 0.5), motion=motion(lot)
    ),
    lambda lot, b: rj.Rope(
        *ends(lot, b[0], b[1]), 0.5, lot.between(1, 9), ends(lot, b[1], rj.ground), 0.3
    ),
    lambda lot, b: rj.Actuator(
        *ends(lot, b[0], rj.ground), random_signal(lot, 1), derivative=1.0, motion=motion(lot)
    ),
    # Angles about axes that are nearly at right angles change too fast for a rotor.
    lambda lot, b: r.JointInertia(
        *ends(lot, b[0], rj.ground), lot.between(0.1, 1), motion="travel"
    ),
    lambda lot, b: rj.PID(
        *ends(lot, b[0], b[1]),
        random_signal(lot, 1.0),
        *lot.between(0, 9, 3),
        least=-1.0,
        tracking=0.3,
        lag=0.2,
        motion=motion(lot),
    ),
    lambda lot, b: rj.LowPass(
        *ends(lot, b[0], b[1]), random_signal(lot, 1.0), lot.between(0.1, 1), derivative=0.3
    ),
    lambda lot, b: rj.HydraulicCylinder(
        *ends(lot, b[0], b[1]),
        random_signal(lot, 1.0),
        1.0,
        0.6,
        0.0,
        9.0,
        8.0,
        0.1,
        0.3,
        bulk=20.0,
    ),
)
