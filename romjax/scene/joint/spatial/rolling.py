"""Wheels and balls that roll on a plane without slip."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....linalg import quaternions
from ...fields import Converted, check_numbers, number
from ...marker import Marker, Pose, Poses, Twists
from ..slip_joint import AbstractSlipJoint


class AbstractRolling(AbstractSlipJoint):
    """The base of round bodies that touch the plane z = 0 of marker `b` at a point of `a` without
    velocity against it.
    """

    radius: eqx.AbstractVar[Float[Array, ""]]
    rows: ClassVar[int] = 3
    slips: ClassVar[tuple[int, ...]] = (1, 2)
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    @abc.abstractmethod
    def touching(self, a: Pose, b: Pose) -> Float[Array, "3"]:
        """The point that touches, from the centre [m]."""

    def height(self, *poses: Pose) -> Float[Array, "1"]:
        a, b = poses
        return b.along(a.position + self.touching(a, b))[None]

    def slip(self, poses: Poses, twists: Twists) -> Float[Array, "2"]:
        return _slipping(poses, twists, self.touching(*poses))

    def check(self) -> None:
        super().check()
        check_numbers(self.owner(), self, "radius", sign="positive")


class RollingDisc(AbstractRolling):
    """A thin disc that rolls on a plane: it touches the plane z = 0 of marker `b`, and the point of
    its rim that does so has no velocity against `b`.

    **Arguments:**

    - `a`: the centre of the disc, with its z axis as the axle; it may lean, but not lie flat.
    - `b`: the plane.
    - `radius` [m]: on the side of positive z.

    Two of its three rows are constraints of velocities (non-holonomic): any place can be reached.
    Raises SceneError for a radius that is not positive.
    """

    a: Marker
    b: Marker
    radius: Converted[Float[Array, ""]] = number()
    name: str = eqx.field(static=True, default="")

    def touching(self, a: Pose, b: Pose) -> Float[Array, "3"]:
        normal, axle = _axis(b), _axis(a)
        # The part of the normal that lies in the plane of the disc.
        upward = normal - jnp.sum(normal * axle) * axle
        return -self.radius * upward / jnp.sqrt(jnp.sum(upward**2))


class RollingBall(AbstractRolling):
    """A ball that rolls on a plane: it touches the plane z = 0 of marker `b`, and the point of it
    that does so has no velocity against `b`. It may spin about the normal of the plane.

    **Arguments:** `a`: the centre of the ball. `b`: the plane. `radius` [m]: on the side of
    positive z.

    Two of its three rows are constraints of velocities (non-holonomic). Raises SceneError for a
    radius that is not positive.
    """

    a: Marker
    b: Marker
    radius: Converted[Float[Array, ""]] = number()
    name: str = eqx.field(static=True, default="")

    def touching(self, a: Pose, b: Pose) -> Float[Array, "3"]:
        del a
        return -self.radius * _axis(b)


def _axis(pose: Pose) -> Float[Array, "3"]:
    """The z axis of a pose."""
    return pose.turned(np.eye(3, dtype=pose.position.dtype)[2])


def _slipping(poses: Poses, twists: Twists, contact: Float[Array, "3"]) -> Float[Array, "2"]:
    """The velocity of the point `contact` of `a`, from its position, against `b`, along x and y."""
    (a, b), (of_a, of_b) = poses, twists
    own = of_a.velocity + jnp.cross(of_a.angular_velocity, contact)
    # The point of `b` that touches moves with its turning too.
    place = a.position + contact - b.position
    other = of_b.velocity + jnp.cross(of_b.angular_velocity, place)
    return quaternions.rotate(quaternions.conjugate(b.turn), own - other)[:2]
