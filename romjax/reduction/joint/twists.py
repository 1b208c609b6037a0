"""Twists and wrenches as vectors about one fixed point, by the inertial axes: sums need no frames.

A twist is (ω, velocity of the point that the body has there), a wrench (torque about it, force); of
3 numbers in the plane, of 6 in space (Featherstone, "Rigid Body Dynamics Algorithms", 2008,
chapter 2, with all vectors by one frame). All functions take leading axes, which broadcast.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import namespace
from ...linalg import quaternions
from ...linalg.dense import multiply
from ...scene.marker import Pose, Twist

Vectors = Float[Array, "*axes d"]
Turns = Float[Array, "..."]


def size(dimension: int) -> int:
    """How many numbers a twist has."""
    return 3 if dimension == 2 else 6


def split(x: Vectors) -> tuple[Array, Array]:
    """ω or torque, and velocity or force."""
    first = 1 if x.shape[-1] == 3 else 3
    return x[..., :first], x[..., first:]


def joined(turning: Array, moving: Array) -> Vectors:
    """The vector of both parts."""
    shape = jnp.broadcast_shapes(turning.shape[:-1], moving.shape[:-1])
    parts = [jnp.broadcast_to(x, (*shape, x.shape[-1])) for x in (turning, moving)]
    return jnp.concatenate(parts, axis=-1)


def of_twist(twist: Twist) -> Vectors:
    """(ω, velocity) as one vector."""
    velocity, turning = twist
    plane = velocity.shape[-1] == 2
    return joined(turning[..., None] if plane else turning, velocity)


def about(turning: Array, arm: Array) -> Array:
    """ω × arm."""
    if arm.shape[-1] == 2:
        return turning * perpendicular(arm)
    return _product(turning, arm)


def moment(arm: Array, force: Array) -> Array:
    """Return arm × force."""
    if arm.shape[-1] == 2:
        return jnp.sum(perpendicular(arm) * force, axis=-1, keepdims=True)
    return _product(arm, force)


def _product(a: Vectors, b: Vectors) -> Vectors:
    """A × b, number by number, which XLA fuses best."""
    (x, y, z), (u, v, w) = ([x[..., i] for i in range(3)] for x in (a, b))
    return jnp.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def perpendicular(x: Float[Array, "*axes 2"]) -> Float[Array, "*axes 2"]:
    """The vector turned by a right angle."""
    return jnp.stack([-x[..., 1], x[..., 0]], axis=-1)


def cross(twist: Vectors, other: Vectors) -> Vectors:
    """The rate of change of a twist vector that moves with a frame of the twist `twist`."""
    (omega, velocity), (turning, moving) = split(twist), split(other)
    change = about(omega, moving) - about(turning, velocity)
    # In the plane all axes of turning are parallel.
    if omega.shape[-1] == 1:
        return joined(jnp.zeros_like(change[..., :1]), change)
    return joined(about(omega, turning), change)


def axes(turn: Turns) -> Float[Array, "*axes d d"]:
    """The rotation matrices of angles in the plane (count,), or of quaternions of unit length
    (count, 4), entry by entry.
    """
    xp = namespace(turn)
    if turn.ndim == 1:
        c, s = xp.cos(turn), xp.sin(turn)
        entries = [c, -s, s, c]
    else:
        w, x, y, z = (turn[..., i] for i in range(4))
        entries = [
            *(w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
            *(2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
            *(2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
        ]
    d = 2 if turn.ndim == 1 else 3
    matrices: Array = xp.stack(entries, axis=-1).reshape(*entries[0].shape, d, d)
    return matrices


def unit(turn: Turns) -> Turns:
    """Quaternions of unit length; angles in the plane as they are."""
    if turn.ndim == 1:
        return turn
    scaled: Array = turn / namespace(turn).sqrt(quaternions.squared(turn))[..., None]
    return scaled


def rotated(axes: Float[Array, "*axes d d"], x: Float[Array, "*axes d"]) -> Array:
    """A vector of 2 or 3 numbers by the axes of a frame, by the inertial axes."""
    return jnp.sum(axes * x[..., None, :], axis=-1)


def from_origin(x: Vectors, arm: Float[Array, "*axes d"]) -> Vectors:
    """The twist about a point that lies at −`arm` from the one that the twist `x` is about."""
    turning, moving = split(x)
    return joined(turning, moving - about(turning, arm))


def wrench_from_origin(x: Vectors, arm: Float[Array, "*axes d"]) -> Vectors:
    """The wrench about a point that lies at −`arm` from the one that the wrench `x` is about."""
    torque, force = split(x)
    return joined(torque + moment(arm, force), force)


def placed(axes: Array, arm: Float[Array, "*axes d"], x: Vectors) -> Vectors:
    """A twist by some `axes` and about their origin, by the inertial axes and about a point from
    which the origin is at `arm`.
    """
    first, second = split(x)
    turning = first if first.shape[-1] == 1 else rotated(axes, first)
    return from_origin(joined(turning, rotated(axes, second)), arm)


def local_twist(pose: Pose, rate: Pose) -> Vectors:
    """The twist of a pose that changes at a `rate`, about the origin of what it is relative to."""
    twist = of_twist(pose.twist(rate))
    return from_origin(twist, pose.position)


def inverse(pose: Pose) -> Pose:
    """The pose of the frame that a pose is relative to, as one sees it from the pose, whose turn
    has unit length.
    """
    plane = pose.dimension == 2
    turn = -pose.turn if plane else quaternions.conjugate(pose.turn)
    return Pose(-rotated(axes(turn), pose.position), turn)


def widened(x: Float[Array, "count k *others"], k: int, axis: int = 1) -> Array:
    """`x` with zeros after what it has along an axis, up to `k` entries."""
    more = [(0, 0)] * x.ndim
    more[axis] = (0, k - x.shape[axis])
    return jnp.pad(x, more) if more[axis][1] else x


def units(count: int, k: int, dtype: np.dtype) -> Float[Array, "k count k"]:
    """The unit vectors of k numbers, each for so many elements."""
    return jnp.broadcast_to(jnp.eye(k, dtype=dtype)[:, None], (k, count, k))


def stopped(x: Array) -> Array:
    """`x` as a number that nothing depends on, of a choice that no result depends on."""
    return jax.lax.stop_gradient(x)


def apply(matrix: Float[Array, "*axes p c"], x: Float[Array, "*axes c"]) -> Float[Array, "*axes p"]:
    """Products of matrices with vectors."""
    return multiply(matrix, x[..., None])[..., 0]
