"""Markers: the only connectors between bodies, joints and effects."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Number, Numbers, Vector, as_array
from ..common.errors import InputError, SceneError
from ..linalg import quaternions
from ..linalg.dense import multiply
from .fields import Converted, check_finite, check_shape, number, radians
from .orientation import quaternion_of
from .points import NamedPoints, by_name, point_of

GROUND = "ground"


class Pose(NamedTuple):
    """The position and the orientation of a marker, in the plane or in space.

    - `position` (2,) or (3,): [m].
    - `turn`: the angle () [rad] in the plane; in space a quaternion (w, x, y, z), of any length,
      that turns the marker's axes from those of space.
    """

    position: Float[Array, "*k d"]  # [m]
    turn: Float[Array, "..."]  # [rad] in the plane

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.position.shape[-1]

    @property
    def angle(self) -> Float[Array, "*k"]:
        """The angle in the plane [rad]; raises InputError in space, where no one angle says it."""
        if self.dimension == 3:
            raise InputError(
                "angle: in space a marker has no angle; take its .rotation (3, 3), or its angle "
                "about the z axis of another pose, .angle_against."
            )
        return self.turn

    @property
    def rotation(self) -> Float[Array, "*k 3 3"]:
        """The rotation matrix in space; its columns are the axes of the marker."""
        return quaternions.matrix(self.turn)

    def along(self, point: Float[Array, " d"]) -> Float[Array, ""]:
        """How far a point, by inertial axes, is along the axis on which joints slide [m]: local x
        in the plane, z in space.
        """
        if self.dimension == 3:
            return self.local(point)[2]
        ahead = jnp.stack([jnp.cos(self.angle), jnp.sin(self.angle)])
        return multiply(ahead, point - self.position)

    def across(self, point: Float[Array, " d"]) -> Float[Array, "*more"]:
        """How far a point is from that axis [m]: local y in the plane, x and y (2,) in space."""
        if self.dimension == 3:
            return self.local(point)[:2]
        aside = jnp.stack([-jnp.sin(self.angle), jnp.cos(self.angle)])
        return multiply(aside, point - self.position)

    def local(self, point: Float[Array, " d"]) -> Float[Array, " d"]:
        """A point of the inertial frame in the marker's own [m]."""
        if self.dimension == 3:
            return quaternions.rotate(quaternions.conjugate(self.turn), point - self.position)
        return jnp.stack([self.along(point), self.across(point)])

    def turned(self, vector: Float[Numbers, " d"]) -> Float[Array, " d"]:
        """A vector of the marker's frame in the inertial one."""
        if self.dimension == 3:
            return quaternions.rotate(self.turn, vector)
        across = jnp.stack([-vector[1], vector[0]])
        return jnp.cos(self.angle) * vector + jnp.sin(self.angle) * across

    def against(self, other: "Pose") -> "Pose":
        """The pose as one sees it who moves and turns with the `other`."""
        if self.dimension == 3:
            turn = quaternions.product(quaternions.conjugate(other.turn), self.turn)
        else:
            turn = self.angle - other.angle
        return Pose(other.local(self.position), turn)

    def angle_against(
        self, other: "Pose", less: Float[Array, ""] | None = None
    ) -> Float[Array, ""]:
        """The angle against another pose, `less` what is given [rad].

        In space it is the angle about the z axis, between −π and π, of two quaternions.
        """
        if self.dimension == 3:
            return quaternions.angle(self.turn, other.turn, less)
        against = self.angle - other.angle
        return against if less is None else against - less

    def about(self, vector: Float[Array, "*d"]) -> Float[Array, ""]:
        """The part of an angular velocity about the axis of joints: all of it in the plane."""
        return vector if self.dimension == 2 else jnp.sum(self._axis() * vector)

    def torque(self, strength: Float[Array, ""]) -> Float[Array, "*d"]:
        """A torque about the axis of joints: normal to the plane, or along the local z."""
        return strength if self.dimension == 2 else strength * self._axis()

    def _axis(self) -> Float[Array, "3"]:
        return self.turned(np.eye(3, dtype=self.position.dtype)[2])

    # Between rates of poses and twists, and by virtual work between slopes by poses and wrenches.
    # In the plane they are the same numbers.

    def twist(self, rate: "Pose") -> "Twist":
        """The twist of a rate of change of the pose."""
        if self.dimension == 3:
            return Twist(rate.position, quaternions.angular_velocity(self.turn, rate.turn))
        return Twist(*rate)

    def rate(self, twist: "Twist") -> "Pose":
        """The rate of change of the pose, for a twist."""
        if self.dimension == 3:
            return Pose(twist.velocity, quaternions.derivative(self.turn, twist.angular_velocity))
        return Pose(*twist)

    def wrench(self, force: "Pose") -> "Wrench":
        """The wrench that does the same work as a generalized force on the pose."""
        if self.dimension == 3:
            return Wrench(force.position, quaternions.torque(self.turn, force.turn))
        return Wrench(*force)

    def force(self, wrench: "Wrench") -> "Pose":
        """The generalized force on the pose that does the same work as a wrench."""
        if self.dimension == 3:
            return Pose(wrench.force, quaternions.generalized(self.turn, wrench.torque))
        return Pose(*wrench)


class Twist(NamedTuple):
    """The velocity and the angular velocity of a marker, by the inertial axes.

    - `velocity` (2,) or (3,): [m/s].
    - `angular_velocity`: () in the plane, (3,) in space [rad/s].
    """

    velocity: Float[Array, "*k d"]  # [m/s]
    angular_velocity: Float[Array, "..."]  # [rad/s]


class Wrench(NamedTuple):
    """The force and the torque on a marker, by the inertial axes.

    - `force` (2,) or (3,): [N].
    - `torque`: () in the plane, (3,) in space [N m].
    """

    force: Float[Array, "*k d"]  # [N]
    torque: Float[Array, "..."]  # [N m]

    def __neg__(self) -> "Wrench":
        return Wrench(-self.force, -self.torque)

    def power(self, twist: Twist) -> Float[Array, "*k"]:
        """The power on a moving marker [W]."""
        moving, turning = self.force * twist.velocity, self.torque * twist.angular_velocity
        in_space = turning.ndim == moving.ndim
        return jnp.sum(moving, axis=-1) + (jnp.sum(turning, axis=-1) if in_space else turning)


# One for each of several markers, in their order.
Poses = tuple[Pose, ...]
Twists = tuple[Twist, ...]
Wrenches = tuple[Wrench, ...]


class Marker(eqx.Module):
    """A frame fixed to a material point of a body, by `body.at(point)` or `ground.at(point)`.

    **Arguments:**

    - `body`: name of the body that carries the marker, or "ground".
    - `point`: the material point X in the body frame [m], (2,) in the plane, (3,) in space.
    - `turn`: rotation of the marker against the body: the angle [rad] in the plane, a quaternion
      (w, x, y, z) of any length in space; none unless given.
    """

    body: str = eqx.field(static=True)
    point: Converted[Float[Array, " d"], Vector] = number()
    turn: Converted[Float[Array, "*shape"], Vector] = radians(default=0.0)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.point.shape[-1]

    @property
    def angle(self) -> Float[Array, ""]:
        """Rotation against the body in the plane [rad]."""
        return self.turn

    def check(self, owner: str) -> None:
        where = f"marker on '{self.body}': "
        if self.point.ndim != 1 or self.dimension not in (2, 3):
            raise SceneError(
                f"{owner}: {where}point has the shape {self.point.shape}; give x, y in the plane, "
                "or x, y, z in space [m]."
            )
        check_finite(owner, f"{where}point", self.point)
        turn = "angle" if self.dimension == 2 else "rotation"
        check_shape(owner, where + turn, self.turn, () if self.dimension == 2 else (4,))
        check_finite(owner, where + turn, self.turn)

    @classmethod
    def fixed(
        cls,
        body: str,
        point: Vector,
        angle: Number = 0.0,
        axis: Vector | None = None,
        rotation: Vector | None = None,
    ) -> "Marker":
        """A marker at a `point` [m] of the `body` of that name, turned by `angle`, `axis` and
        `rotation` as in `AbstractBody.at`.
        """
        at = as_array(point)
        if at.shape != (3,):
            if axis is not None or rotation is not None:
                raise SceneError(
                    f"marker on '{body}': axis and rotation are those of space, but the point is "
                    f"{point}; give x, y, z, or an angle in the plane."
                )
            return cls(body, at, angle)
        return cls(body, at, quaternion_of(f"marker on '{body}'", axis, rotation, angle))


class Ground(eqx.Module):
    """The inertial frame; `ground.at(point)` marks a fixed point.

    A `Ground` of one's own has `points` by name: `Ground({"pivot": (0.0, 0.0)}).at("pivot")`.
    """

    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())

    def named_points(self) -> Mapping[str, Float[Array, " d"]]:
        """The points [m] that `at` and `pose` know by name."""
        return self.points.mapping()

    def at(
        self,
        point: Vector | str = (0.0, 0.0),
        angle: Number = 0.0,
        *,
        axis: Vector | None = None,
        rotation: Vector | None = None,
    ) -> Marker:
        """A marker at a `point` [m] of the inertial frame, or the one of that name, turned by
        `angle` [rad], or by `axis` or `rotation` in space, as those of bodies.
        """
        at = point_of(GROUND, self.named_points(), point)
        return Marker.fixed(GROUND, at, angle, axis, rotation)

    def pose(self, point: Vector | str = (0.0, 0.0)) -> Pose:
        """A fixed position, as in `at`, at an angle of zero."""
        marker = self.at(point)
        return Pose(marker.point, marker.turn)


ground = Ground()
