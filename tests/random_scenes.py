"""Scenes by lot, from a seed: every kind of body, joint, effect, curve and signal."""

import dataclasses
from typing import Any

import jax
import mechanics
import numpy as np

import romjax as rj

MOST_BODIES = 6
SPOILT = 0.2  # the share of scenes with joints that do not fit each other
OF_ROBOTS = 12  # the structure with the effects that robots bring


@dataclasses.dataclass
class Lot:
    """Two streams of chance: `kinds` says what there is, `numbers` how large it is.

    Scenes that share the first have one structure and so one compiled program.
    """

    kinds: np.random.Generator
    numbers: np.random.Generator

    def one_of(self, items: Any) -> Any:
        return items[self.kinds.integers(len(items))]

    def chance(self, share: float) -> bool:
        return bool(self.kinds.random() < share)

    def maybe(self, low: float, high: float, shape: Any = ()) -> Any:
        """A number that an element may also do without."""
        return self.between(low, high, shape) if self.chance(0.5) else None

    def between(self, low: float, high: float, shape: Any = ()) -> Any:
        return self.numbers.uniform(low, high, shape)

    def around(self, size: float, shape: Any = ()) -> Any:
        return self.between(-size, size, shape)


def random_scene(seed: int, structure: int | None = None) -> rj.Scene:
    """One to six bodies whose joints hold at the start, but for a few spoilt scenes.

    Scenes of one `structure` (that of the seed unless given) differ in their numbers alone.
    """
    kinds = np.random.default_rng([0, seed if structure is None else structure])
    lot = Lot(kinds, np.random.default_rng([1, seed]))
    bodies, joints = [], []
    for k in range(lot.kinds.integers(1, MOST_BODIES + 1)):
        body = random_body(lot, f"body{k}")
        if lot.chance(0.85):
            body, joint = hung(lot, body, lot.one_of([None, *bodies]), bodies)
            joints.append(joint)
        bodies.append(body)
    joints += [closing_joint(lot, bodies) for _ in range(lot.kinds.integers(3))]
    if lot.chance(SPOILT):
        joints += lot.one_of(SPOILERS)(lot, bodies)
    if structure == OF_ROBOTS:
        joints.append(rj.KnifeEdge(*ends(lot, bodies)))
        return rj.Scene(bodies, joints, [make(lot, bodies) for make in ROBOT_EFFECTS])
    effects = [lot.one_of(EFFECTS)(lot, bodies) for _ in range(lot.kinds.integers(1, 7))]
    return rj.Scene(bodies, joints, effects)


def random_body(lot: Lot, name: str) -> rj.AbstractBody:
    """Of some kilograms and some decimetres; flexible ones are bent a little."""
    start = {
        "position": lot.around(1.5, 2),
        "angle": lot.around(3.0),
        "velocity": lot.around(1.0, 2),
        "angular_velocity": lot.around(2.0),
    }
    mass = lot.between(0.3, 3.0)
    if lot.chance(0.5):
        return rj.RigidBody(name, mass=mass, inertia=lot.between(0.05, 0.5), **start)
    modes = int(lot.kinds.integers(4))
    material = {"EI": lot.between(2.0, 20.0), "modes": modes}
    if modes and lot.chance(0.5):
        material = {"frequencies": np.sort(lot.between(2.0, 30.0, modes))}
    return rj.Beam(
        name,
        mass,
        lot.between(0.5, 1.5),
        inertia=lot.maybe(0.6, 0.8),  # more than that of a bar of 3 kg and 1.5 m
        axis=lot.one_of("xy"),
        shapes=lot.one_of([None, "clamped-free", "pinned-free"]),
        damping=lot.maybe(0.0, 0.1),
        amplitudes=lot.around(0.03, modes),
        rates=lot.around(0.3, modes),
        **material,
        **start,
    )


def random_marker(lot: Lot, body: rj.AbstractBody | None) -> rj.Marker:
    """On the axis of a beam, near the centre of a rigid body, or (None) on the ground."""
    angle = lot.around(3.0)
    if body is None:
        return rj.ground.at(lot.around(1.5, 2), angle)
    if isinstance(body, rj.Beam):
        along = lot.around(0.5) * float(body.length)
        return body.at((along, 0.0) if body.axis == "x" else (0.0, along), angle)
    return body.at(lot.around(0.4, 2), angle)


def random_signal(lot: Lot, size: float, smooth: bool = False) -> rj.AbstractSignal:
    """Slow enough that the motion of a fifth of a second is one; smooth as joints need it."""
    height, frequency = lot.around(size), lot.between(0.5, 3.0)
    kinds = [
        lambda: rj.Constant(height),
        lambda: rj.Ramp(height, lot.around(size)),
        lambda: rj.Sine(height, frequency, phase=lot.around(3.0)),
        lambda: rj.Chirp(height, frequency, rate=lot.around(2.0)),
        lambda: rj.Step(height, lot.around(0.1), lot.between(0.1, 0.3)),
    ]
    if not smooth:  # twice, for no joint has it
        kinds += 2 * [lambda: rj.Table([0.0, 0.1, 0.3], lot.around(size, 3))]
    return lot.one_of(kinds)()


# Where markers are


def marker_pose(scene: rj.Scene, marker: rj.Marker, q: Any) -> rj.Pose:
    """The place of its material point; the angle of the frame, the slope there, and its own."""
    angle = marker.angle
    for body in scene.bodies:
        if body.name == marker.body:
            own = mechanics.coordinates(scene, q)[body.name]
            angle = angle + own[2] + body.mode_shapes(marker.point)[2] @ own[3:]
    return rj.Pose(mechanics.marker_place(scene, marker, q), angle)


def start_pose(bodies: list[rj.AbstractBody], marker: rj.Marker) -> rj.Pose:
    """Where a marker is at the start; by NumPy, which compiles nothing."""
    position, angle = np.asarray(marker.point), np.asarray(marker.angle)
    for body in bodies:
        if body.name == marker.body:
            q, shapes = np.asarray(body.start()[0]), np.asarray(body.mode_shapes(marker.point))
            c, s = np.cos(q[2]), np.sin(q[2])
            arm = position + shapes[:2] @ q[3:]
            position = q[:2] + np.array([[c, -s], [s, c]]) @ arm
            angle = angle + q[2] + shapes[2] @ q[3:]
    return rj.Pose(position, angle)


# Joints


def fitted_joint(lot: Lot, kind: type, a: rj.Marker, b: rj.Marker, bodies: list) -> Any:
    """A joint whose numbers, or the angle of marker b, are such that it holds at the start.

    Of Revolute and Weld the places have to fit already.
    """
    at, of = start_pose(bodies, a), start_pose(bodies, b)
    twist, local = at.angle - of.angle, of.local(at.position)
    local = np.asarray(local)
    bearing = np.arctan2(local[1], local[0])
    aimed = dataclasses.replace(b, turn=b.angle + bearing)  # its x axis passes through a
    ratio, signal = lot.between(-3.0, 3.0), random_signal(lot, 0.2, smooth=True)
    turn, travel = rj.Constant(twist - signal(0.0)), rj.Constant(local[0] - signal(0.0))
    apart = rj.Constant(np.linalg.norm(local) - signal(0.0))
    fits = {
        rj.Revolute: lambda: {},
        rj.Weld: lambda: {"value": twist},
        rj.FixedAngle: lambda: {"value": twist},
        rj.Prismatic: lambda: {"b": aimed, "value": twist - bearing},
        rj.PointOnLine: lambda: {"b": aimed},
        rj.PointOnCurve: lambda: fitted_curve(lot, local, aimed),
        rj.Distance: lambda: {"length": np.linalg.norm(local)},
        rj.Gear: lambda: {"ratio": ratio, "offset": at.angle - ratio * of.angle},
        rj.PrescribedAngle: lambda: {"signal": rj.Sum((signal, turn))},
        rj.PrescribedTravel: lambda: {"signal": rj.Sum((signal, travel))},
        rj.PrescribedDistance: lambda: {"signal": rj.Sum((signal, apart))},
    }
    return kind(**{"a": a, "b": b, **fits[kind]()})


def fitted_curve(lot: Lot, local: jax.Array, aimed: rj.Marker) -> dict[str, Any]:
    """A curve through a point of the frame of marker b, or the x axis turned towards it."""
    bends = lot.around(0.5, 2)
    fits = [
        {"curve": rj.Circle(np.linalg.norm(local))},
        {"curve": rj.Polynomial([local[1] - np.polyval([*bends, 0.0], local[0]), *bends[::-1]])},
        {"curve": rj.Line(), "b": aimed},
    ]
    return lot.one_of(fits)


MEETING = (rj.Revolute, rj.Weld)  # joints that hold two markers in one place
TURNING = (rj.FixedAngle, rj.Gear, rj.PrescribedAngle)
DRIVEN = (rj.PrescribedTravel, rj.PrescribedDistance)
SLIDING = (rj.Prismatic, rj.PointOnLine, rj.PointOnCurve, rj.Distance, *DRIVEN)
JOINTS = (rj.Revolute, *MEETING, *TURNING, *SLIDING)  # the most common of all twice


def hung(
    lot: Lot, body: rj.AbstractBody, parent: rj.AbstractBody | None, bodies: list
) -> tuple[rj.AbstractBody, rj.AbstractJoint]:
    """A body on an earlier one or the ground; it is moved to where its joint holds."""
    kind, a, b = lot.one_of(JOINTS), random_marker(lot, body), random_marker(lot, parent)
    if kind in MEETING:
        gap = start_pose(bodies, b).position - start_pose([body], a).position
        body = dataclasses.replace(body, position=body.position + gap)
    return body, fitted_joint(lot, kind, a, b, [*bodies, body])


def closing_joint(lot: Lot, bodies: list[rj.AbstractBody]) -> rj.AbstractJoint:
    """One more joint between bodies that stay where they are.

    Where markers must meet, the second is moved, and so is not on a beam, whose points are few.
    """
    kind, body = lot.one_of(JOINTS), lot.one_of(bodies)
    meets = kind in MEETING
    free = [b for b in bodies if b is not body and not (meets and isinstance(b, rj.Beam))]
    a, b = random_marker(lot, body), random_marker(lot, lot.one_of([None, *free]))
    if meets:
        at, of = start_pose(bodies, a), start_pose(bodies, b)
        frame = rj.Pose(of.position, of.angle - b.angle)  # turned as the body is
        b = dataclasses.replace(b, point=b.point + frame.local(at.position))
    return fitted_joint(lot, kind, a, b, bodies)


# What spoils a scene


def two_lengths(lot: Lot, bodies: list) -> list[rj.AbstractJoint]:
    """Links of two lengths between the same points: nowhere do both hold."""
    a, b = random_marker(lot, lot.one_of(bodies)), random_marker(lot, None)
    link = fitted_joint(lot, rj.Distance, a, b, bodies)
    return [link, dataclasses.replace(link, length=link.length + 0.3)]


def nailed(lot: Lot, bodies: list) -> list[rj.AbstractJoint]:
    """Every body welded to the ground, the first one twice."""
    places = [(body.at(), rj.Pose(body.position, body.angle)) for body in [bodies[0], *bodies]]
    return [rj.Weld(marker, rj.ground.at(*pose)) for marker, pose in places]


def two_angles(lot: Lot, bodies: list) -> list[rj.AbstractJoint]:
    """An angle that is held and turned at once: no velocity does both."""
    a, b = lot.one_of(bodies).at(), random_marker(lot, None)
    held = fitted_joint(lot, rj.FixedAngle, a, b, bodies)
    turn = rj.Sum((rj.Sine(0.5, 2.0), rj.Constant(held.value)))
    return [held, rj.PrescribedAngle(a, b, turn)]


def wrong_length(lot: Lot, bodies: list) -> list[rj.AbstractJoint]:
    """A link that is too long: the start has to be corrected, if the rest allows it."""
    return two_lengths(lot, bodies)[1:]


SPOILERS = (two_lengths, nailed, two_angles, wrong_length)


# Effects


def ends(lot: Lot, bodies: list) -> tuple[rj.Marker, rj.Marker]:
    """A marker on a body, and one on any other, the same, or the ground."""
    return random_marker(lot, lot.one_of(bodies)), random_marker(lot, lot.one_of([None, *bodies]))


def random_contact(lot: Lot, bodies: list) -> rj.Contact:
    """With a curve near enough to be met now and then; slow creep would take many short steps."""
    bends = lot.around(0.5, 3)
    curve = lot.one_of([rj.Line(), rj.Circle(lot.between(0.5, 1.5)), rj.Polynomial(bends)])
    friction = None
    if lot.chance(0.5):
        rough, slow = lot.between(0.1, 0.4), lot.between(0.05, 0.2)
        stribeck = lot.one_of([{}, {"static": rough + 0.2, "stribeck": 0.5}])
        friction = rj.Friction(rough, slow, **stribeck)
    return rj.Contact(
        *ends(lot, bodies),
        curve,
        lot.between(50.0, 500.0),
        dissipation=lot.maybe(0.0, 1.0),
        friction=friction,
    )


EFFECTS = (
    lambda lot, bodies: rj.Gravity(lot.around(10.0, 2)),
    lambda lot, bodies: rj.Spring(
        *ends(lot, bodies),
        lot.between(1.0, 100.0),
        rest_length=lot.maybe(0.0, 1.0),
        cubic=lot.maybe(0.0, 100.0),
    ),
    lambda lot, bodies: rj.Damper(
        *ends(lot, bodies), lot.between(0.0, 3.0), along_line=lot.chance(0.5)
    ),
    lambda lot, bodies: rj.TorsionSpring(*ends(lot, bodies), lot.between(0, 10), lot.around(1.0)),
    lambda lot, bodies: rj.TorsionDamper(*ends(lot, bodies), lot.between(0.0, 1.0)),
    lambda lot, bodies: rj.Bushing(
        *ends(lot, bodies), lot.between(0.0, 50.0, 3), lot.maybe(0.0, 1.0, 3)
    ),
    lambda lot, bodies: rj.Force(
        random_marker(lot, lot.one_of(bodies)),
        lot.around(1.0, 2),
        random_signal(lot, 10.0),
        frame=lot.one_of(["world", "body"]),
    ),
    lambda lot, bodies: rj.Torque(random_marker(lot, lot.one_of(bodies)), random_signal(lot, 3.0)),
    lambda lot, bodies: rj.Drag(
        random_marker(lot, lot.one_of(bodies)), lot.between(0.3, 1.2), lot.between(0.1, 1.0)
    ),
    lambda lot, bodies: rj.Motor(
        *ends(lot, bodies), random_signal(lot, 1.0), lot.between(0.0, 10.0), lot.between(0.0, 1.0)
    ),
    random_contact,
)

ROBOT_EFFECTS = (
    lambda lot, bodies: rj.JointSpring(*ends(lot, bodies), lot.between(0, 10), lot.around(1.0)),
    lambda lot, bodies: rj.JointDamper(
        *ends(lot, bodies), lot.between(0, 1), rj.Friction(0.3, 0.1), motion="travel"
    ),
    lambda lot, bodies: rj.JointStop(
        *ends(lot, bodies), -0.1, 0.1, lot.between(1, 9), lot.between(0, 1), motion="travel"
    ),
    lambda lot, bodies: rj.Rope(
        *ends(lot, bodies), 0.5, lot.between(1, 9), ends(lot, bodies), lot.between(0, 1)
    ),
    lambda lot, bodies: rj.Actuator(
        *ends(lot, bodies), random_signal(lot, 1.0), gear=2.0, derivative=0.5, motion="distance"
    ),
    lambda lot, bodies: rj.PID(
        *ends(lot, bodies),
        random_signal(lot, 1.0),
        *lot.between(0, 9, 3),
        least=-1.0,
        tracking=0.3,
        lag=0.2,
        motion="travel",
    ),
    lambda lot, bodies: rj.LowPass(
        *ends(lot, bodies), random_signal(lot, 1.0), lot.between(0.1, 1), derivative=0.3
    ),
    lambda lot, bodies: rj.HydraulicCylinder(
        *ends(lot, bodies), random_signal(lot, 1.0), 1.0, 0.6, 0.0, 9.0, 8.0, 0.1, 0.3, bulk=20.0
    ),
)
