"""Directions of markers, and how they differ: what joints are made of, most of it in space."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import concrete
from ...common.errors import SceneError
from ...linalg import quaternions
from ..marker import Pose

# The twists of a unit turn about the axis of joints, z in space, and of a unit travel along it, x
# in the plane and z in space, by the dimension: angular velocity, then velocity.
TURNING = {2: (1, 0, 0), 3: (0, 0, 1, 0, 0, 0)}
SLIDING = {2: (0, 1, 0), 3: (0, 0, 0, 0, 0, 1)}


def axis(pose: Pose, number: int) -> Float[Array, "3"]:
    """The local x, y or z axis of a marker, by number, in the inertial frame."""
    return pose.turned(np.eye(3, dtype=pose.position.dtype)[number])


def tilt(a: Pose, b: Pose) -> Float[Array, "2"]:
    """The components of the z axis of `a` along x and y of `b`: zero where both are parallel, and
    for small angles the angles between them [rad].
    """
    relative = quaternions.product(quaternions.conjugate(b.turn), a.turn)
    # Only the third column of its matrix, 2 (x z + w y, y z − w x) / s, is computed: joints that
    # turn are made of it, and derivatives of one rotation are half of those of two.
    w, xy, z = relative[0], relative[1:3], relative[3]
    across = jax.lax.rev(xy, (0,)) * np.array([1, -1], xy.dtype)
    return 2 * (z * xy + w * across) / quaternions.squared(relative)


def turned(a: Pose, b: Pose) -> Float[Array, "3"]:
    """Twice the vector part of the quaternion from `b` to `a`, over its length: the axis times
    2 sin(φ/2) [rad], which is zero only where all axes are parallel.
    """
    relative = quaternions.product(quaternions.conjugate(b.turn), a.turn)
    return 2 * relative[1:] / jnp.sqrt(quaternions.squared(relative))


def about_axis(angle: Float[Array, ""], dimension: int) -> Float[Array, "*turn"]:
    """The turn of a pose by an `angle` [rad] about the axis of joints."""
    return angle if dimension == 2 else about_z(angle)


def about_z(angle: Float[Array, ""]) -> Float[Array, "4"]:
    """The quaternion of a rotation about the z axis by an `angle` [rad]."""
    (c, s), none = _half(angle), jnp.zeros_like(angle)
    return jnp.stack([c, none, none, s])


@jax.custom_jvp
def _half(angle: Float[Array, ""]) -> tuple[Array, Array]:
    """The cosine and the sine of half an angle, of which all derivatives are made."""
    return jnp.cos(0.5 * angle), jnp.sin(0.5 * angle)


@_half.defjvp
def _change_of_half(
    primals: tuple[Array], tangents: tuple[Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    c, s = _half(*primals)
    half = 0.5 * tangents[0]
    return (c, s), (-s * half, c * half)


def angle_about_z(a: Pose, b: Pose) -> Float[Array, ""]:
    """The angle of `a` against `b` about the z axis, between −π and π [rad].

    As `Pose.angle_against`, but smooth at a half turn too, up to full turns.
    """
    relative = quaternions.product(quaternions.conjugate(b.turn), a.turn)
    # p and −p turn alike; of both the one with w ≥ 0 has an angle between −π and π.
    w, z = jnp.where(relative[0] < 0, -1, 1) * relative[np.array([0, 3])]
    return 2 * jnp.arctan2(z, w)


def angle_about_axis(a: Pose, b: Pose) -> Float[Array, ""]:
    """The angle of `a` against `b` about the axis of joints [rad], in space as `angle_about_z`."""
    return a.angle - b.angle if a.dimension == 2 else angle_about_z(a, b)


def drop_angle(joint: Any) -> None:
    """Take the angle `value`, which a joint keeps in the plane, from one in space, so that no
    program has it as input; raises SceneError for one that is given there.
    """
    if joint.b.dimension == 2:
        return
    given = None if joint.value is None else concrete(joint.value)
    if joint.value is not None and (given is None or np.any(given)):
        raise SceneError(
            f"{joint.owner()}: value is {joint.value}, an angle of the plane; in space all axes "
            "stay parallel: turn a marker instead, by its `rotation` or `angle`.",
            field="value",
        )
    joint.value = None
