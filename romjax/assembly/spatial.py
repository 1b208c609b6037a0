"""The motion of markers in space: frames with x, y, z [m] and a quaternion of any length."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Numbers
from ..linalg import quaternions
from ..linalg.dense import multiply
from ..scene.marker import Pose
from .pose_gradient import PoseGradient

# What stands for the coordinates of the ground, after those of the bodies.
GROUND = (0.0, 1.0)


def ground(n: int) -> tuple[int, ...]:
    """The columns of the frame of the ground: at the origin, with the quaternion (1, 0, 0, 0)."""
    return (n, n, n, n + 1, n, n, n)


def bend(
    turns: Float[Array, "count 4"], turned: Float[Array, "count 3"]
) -> Float[Array, "count 4"]:
    """The turns of markers on bodies whose points are `turned` by their modes [rad]."""
    return quaternions.product(quaternions.small_turn(turned), turns)


def turned(own: Float[Array, "count 4"], turns: Float[Array, "count 4"]) -> Float[Array, "count 4"]:
    """The turns of markers turned by `turns` on points that are turned themselves."""
    return quaternions.product(own, turns)


def about(
    turns: Float[Array, "count 4"], local: Float[Array, "count 4"], rows: Sequence[tuple[int, ...]]
) -> Float[Array, "count 4"]:
    """Select what small turns of points turn: the markers' `turns`, or the `local` ones on bodies
    that bend far, whose markers are in `rows`.
    """
    for own in rows:
        turns = turns.at[np.array(own)].set(local[np.array(own)])
    return turns


def compose(frame: Pose, local: Pose) -> Pose:
    """The poses of markers whose bodies have the poses `frame`."""
    arm = quaternions.rotate(frame.turn, local.position)
    return Pose(frame.position + arm, quaternions.product(frame.turn, local.turn))


def gradient(
    p: Float[Array, "count 4"],
    local: Pose,
    turns: Float[Array, "count 4"],
    shapes: Float[Numbers, "count 6 modes"],
) -> PoseGradient:
    """The derivatives of `compose` by the quaternion p and amplitudes.

    A turn of the frame δϑ = 2 E δp / s moves the arm a by δϑ × a. The quaternion p ⊗ b ⊗ c of a
    marker is linear in p, and in the turn ½ s q_f of its point, which is the vector of b; where a
    body bends far, `turns` are b ⊗ c, and ½ s turns these.
    """
    arm = quaternions.skew(quaternions.rotate(p, local.position))
    turning = 2 * quaternions.space_matrix(p) / quaternions.squared(p)[:, None, None]
    position = [-multiply(arm, turning)]
    # The matrix of p ⊗ b in p is (b, Eᵀ(b)).
    columns = [local.turn[:, None], quaternions.space_matrix(local.turn)]
    turn = [jnp.swapaxes(jnp.concatenate(columns, axis=1), 1, 2)]
    if shapes.shape[2]:
        position.append(multiply(quaternions.matrix(p), shapes[:, :3]))
        vectors = quaternions.from_vector(0.5 * jnp.swapaxes(shapes[:, 3:], 1, 2))
        p, turns = (jnp.broadcast_to(x[:, None], vectors.shape) for x in (p, turns))
        around = quaternions.product(p, quaternions.product(vectors, turns))
        turn.append(jnp.swapaxes(around, 1, 2))
    return PoseGradient(jnp.concatenate(position, axis=2), jnp.concatenate(turn, axis=2))
