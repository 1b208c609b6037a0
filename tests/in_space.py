"""Planar mechanisms, put into space: each must move as its planar twin."""

import dataclasses
import itertools

import jax.numpy as jnp
import numpy as np
from modal_twins import modal_twin

import romjax as rj
from romjax.linalg import quaternions

r = rj.spatial
# Rotations of a marker that bring its z axis to what is its x or its y axis.
TO_X = np.array([1.0, 0.0, 1.0, 0.0])
TO_Y = np.array([1.0, -1.0, 0.0, 0.0])


class Extruded(r.AbstractSurface):
    """What a curve of the plane is the section of."""

    curve: rj.AbstractCurve

    def __call__(self, point):
        return self.curve(point[:2])

    def check(self, owner):
        self.curve.check(owner)


class InSpace:
    """A planar `scene` in the plane that a quaternion `turn` makes of z = 0.

    - `scene`: its twin, whose bodies are held in that plane. Of angles that count, the twin knows
      nothing before the start, where they are between −π and π: their zeros are moved accordingly.
    - `rows`: for each joint of the planar scene, the numbers of the twin's rows that stand for its
      rows; `frames`: the marker by whose axes they are, where planar ones are by those of space.
    """

    def __init__(self, scene: rj.Scene, turn: np.ndarray):
        self.turn, self.planar = np.asarray(turn), scene
        bodies = [self._body(body) for body in scene.bodies]
        plane = rj.ground.at((0, 0, 0), rotation=self.turn)
        joints = [r.Planar(body.at((0, 0, 0)), plane, name="plane") for body in bodies]
        self.rows, self.frames, row = [], [], 3 * len(joints)
        for joint in scene.joints:
            twins = JOINTS[type(joint)](self, joint)
            count = sum(twin.rows for twin in twins)
            self.rows.append(range(row, row + joint.rows))
            meets = isinstance(joint, rj.Revolute | rj.Weld)
            self.frames.append(joint.b if meets else None)
            joints += twins
            row += count
        effects = [EFFECTS[type(effect)](self, effect) for effect in scene.effects]
        self.scene = rj.Scene(bodies, joints, effects)

    # Of parts

    def vector(self, x) -> np.ndarray:
        """A vector of the plane in space."""
        return rotated(self.turn, np.append(np.asarray(x, float), 0.0))

    def _body(self, body) -> rj.AbstractBody:
        q, v = (np.asarray(x) for x in body.start())
        moving = {
            "position": self.vector(q[:2]),
            "orientation": quaternions.product(self.turn, about_z(q[2])),
            "velocity": self.vector(v[:2]),
            "angular_velocity": rotated(self.turn, np.array([0.0, 0.0, v[2]])),
        }
        if body.modes:
            return modal_twin(self.planar, body, moving)
        mass = np.asarray(body.mass_matrix(q))
        return r.RigidBody(body.name, mass[0], mass[2] * np.array([0.6, 0.7, 1.0]), **moving)

    def marker(self, marker: rj.Marker, then=(1.0, 0.0, 0.0, 0.0)) -> rj.Marker:
        """The marker with its z axis normal to the plane, before a rotation of its own."""
        turn = quaternions.product(about_z(marker.angle), np.asarray(then))
        point = np.append(marker.point, 0.0)
        if marker.body == "ground":
            turn, point = quaternions.product(self.turn, turn), self.vector(marker.point)
        return rj.Marker(marker.body, point, turn)

    def ends(self, part) -> dict[str, rj.Marker]:
        return {"a": self.marker(part.a), "b": self.marker(part.b)}

    def unwound(self, *markers: rj.Marker) -> float:
        """What the angle of a marker, or of one against another, is more in space at the start."""
        q = np.concatenate([body.start()[0] for body in self.planar.bodies])
        own = self._by_body(q)
        angles = [
            float(m.angle) + (0.0 if m.body == "ground" else float(own[m.body][2])) for m in markers
        ]
        angle = angles[0] - sum(angles[1:])
        return -2 * np.pi * np.round(angle / (2 * np.pi))

    # Of states

    def multipliers(self, values, q) -> np.ndarray:
        """Of the planar scene, from those of its twin, at the planar coordinates q."""
        own, found, values = self._by_body(q), [], np.asarray(values)
        for rows, frame in zip(self.rows, self.frames, strict=True):
            part = values[rows.start : rows.stop].copy()
            if frame is not None:
                angle = self._angle(frame, own)
                c, s = np.cos(angle), np.sin(angle)
                part[:2] = np.array([[c, -s], [s, c]]) @ part[:2]
            found.append(part)
        return np.concatenate(found) if found else np.zeros(0)

    def _angle(self, marker: rj.Marker, own) -> float:
        """Of a marker of the planar scene, at coordinates by body."""
        for body in self.planar.bodies:
            if body.name == marker.body:
                q = own[body.name]
                shapes = np.asarray(body.mode_shapes(jnp.asarray(marker.point)))
                return float(marker.angle) + q[2] + shapes[2] @ q[3:]
        return float(marker.angle)

    def accelerations(self, q, a) -> tuple[np.ndarray, float]:
        """Of the planar coordinates, and the largest part out of the plane."""
        found, out = [], 0.0
        q, a = np.asarray(q), np.asarray(a)
        for own in self._slices():
            p, ddp = q[own][3:7], a[own][3:7]
            # The rate of 2 E ṗ / s, as E(ṗ) ṗ = 0 and the length is constant.
            turning = 2 * quaternions.apply(quaternions.space_matrix(p), ddp) / (p @ p)
            back = quaternions.conjugate(self.turn)
            line = rotated(back, a[own][:3])
            turning = rotated(back, turning)
            found += [line[0], line[1], turning[2], *a[own][7:]]
            out = max(out, abs(line[2]), abs(turning[0]), abs(turning[1]))
        return np.array(found), out

    def coordinates(self, q) -> np.ndarray:
        """Of the plane, (k, n), of those of the twin; angles up to full turns."""
        found, back = [], quaternions.conjugate(self.turn)
        for columns in self._slices():
            own = np.asarray(q)[:, columns]
            turned = np.broadcast_to(back, own[:, 3:7].shape)
            line = quaternions.rotate(turned, own[:, :3])
            turn = quaternions.product(turned, own[:, 3:7])
            found += [line[:, 0], line[:, 1], 2 * np.arctan2(turn[:, 3], turn[:, 0]), *own[:, 7:].T]
        return np.stack(found, axis=1)

    def _by_body(self, q) -> dict[str, np.ndarray]:
        """The planar coordinates of each body."""
        ends = np.cumsum([body.size for body in self.planar.bodies])[:-1]
        names = (body.name for body in self.planar.bodies)
        return dict(zip(names, np.split(np.asarray(q), ends), strict=True))

    def _slices(self) -> list[slice]:
        """Of the coordinates of each body of the twin."""
        ends = np.cumsum([0] + [7 + body.modes for body in self.planar.bodies])
        return [slice(*pair) for pair in itertools.pairwise(ends)]


def rotated(turn: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return quaternions.rotate(turn[None], vector[None])[0]


def about_z(angle) -> np.ndarray:
    half = 0.5 * float(angle)
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def shifted(signal: rj.AbstractSignal, by: float) -> rj.AbstractSignal:
    return rj.Sum((signal, rj.Constant(by)))


def gear(self: InSpace, joint: rj.Gear) -> list:
    ground = rj.ground.at((0, 0, 0), rotation=self.turn)
    bearings = [self.marker(x) if x else ground for x in (joint.bearing_a, joint.bearing_b)]
    offset = joint.offset + self.unwound(joint.a) - joint.ratio * self.unwound(joint.b)
    ends = self.ends(joint)
    return [r.Gear(ends["a"], ends["b"], *bearings, ratio=joint.ratio, offset=offset)]


def along_x(self: InSpace, joint) -> list[rj.Marker]:
    """The ends of a joint, of which `b` has its z axis normal to the axis on which `a` slides."""
    return [self.marker(joint.a), self.marker(joint.b, TO_Y)]


def angle(self: InSpace, joint) -> rj.FixedAngle:
    return rj.FixedAngle(**self.ends(joint), value=joint.value)


JOINTS = {
    rj.Revolute: lambda self, j: [rj.PointOnLine(**self.ends(j))],
    rj.Weld: lambda self, j: [rj.PointOnLine(**self.ends(j)), angle(self, j)],
    rj.Prismatic: lambda self, j: [r.PointOnPlane(*along_x(self, j)), angle(self, j)],
    rj.PointOnLine: lambda self, j: [r.PointOnPlane(*along_x(self, j))],
    rj.PointOnCurve: lambda self, j: [r.PointOnCurve(**self.ends(j), curve=j.curve)],
    rj.FixedAngle: lambda self, j: [angle(self, j)],
    rj.Distance: lambda self, j: [rj.Distance(**self.ends(j), length=j.length)],
    rj.Gear: gear,
    rj.PrescribedAngle: lambda self, j: [rj.PrescribedAngle(**self.ends(j), signal=j.signal)],
    rj.PrescribedDistance: lambda self, j: [rj.PrescribedDistance(**self.ends(j), signal=j.signal)],
    rj.PrescribedTravel: lambda self, j: [
        rj.PrescribedTravel(self.marker(j.a), self.marker(j.b, TO_X), j.signal)
    ],
}


def same(self: InSpace, effect) -> rj.AbstractMarkerEffect:
    """Between other markers, with the same numbers."""
    markers = {
        field.name: self.marker(getattr(effect, field.name))
        for field in dataclasses.fields(effect)
        if isinstance(getattr(effect, field.name), rj.Marker)
    }
    return dataclasses.replace(effect, **markers)


def wound(self: InSpace, effect) -> rj.AbstractMarkerEffect:
    """What acts on an angle that counts."""
    more = self.unwound(effect.a, effect.b)
    if isinstance(effect, rj.Motor):
        return dataclasses.replace(same(self, effect), target=shifted(effect.target, more))
    return dataclasses.replace(same(self, effect), rest_angle=effect.rest_angle + more)


def bushing(self: InSpace, effect: rj.Bushing) -> rj.AbstractMarkerEffect:
    def six(x):
        return None if x is None else np.array([x[0], x[1], 0, 0, 0, x[2]])

    return r.Bushing(
        **self.ends(effect), stiffness=six(effect.stiffness), damping=six(effect.damping)
    )


def contact(self: InSpace, effect: rj.Contact) -> rj.AbstractMarkerEffect:
    names = ("stiffness", "dissipation", "friction")
    law = {name: getattr(effect, name) for name in names}
    return r.Contact(**self.ends(effect), surface=Extruded(effect.curve), **law)


def force(self: InSpace, effect: rj.Force) -> rj.AbstractMarkerEffect:
    given = effect.direction
    direction = np.append(given, 0.0) if effect.frame == "body" else self.vector(given)
    return dataclasses.replace(effect, at=self.marker(effect.at), direction=direction)


EFFECTS = {
    rj.Gravity: lambda self, e: rj.Gravity(self.vector(e.acceleration)),
    rj.Spring: same,
    rj.Damper: same,
    rj.TorsionDamper: same,
    rj.Drag: same,
    rj.TorsionSpring: wound,
    rj.Motor: wound,
    rj.Bushing: bushing,
    rj.Contact: contact,
    rj.Force: force,
    rj.Torque: same,
}
