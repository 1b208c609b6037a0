"""The motion of markers in the plane: frames with x, y [m] and φ [rad]."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Numbers
from ..scene.marker import Pose
from .pose_gradient import PoseGradient

# What stands for the coordinates of the ground, after those of the bodies.
GROUND = (0.0,)


def ground(n: int) -> tuple[int, ...]:
    """The columns of the frame of the ground."""
    return (n, n, n)


def bend(angles: Float[Array, " count"], turned: Float[Array, "count 1"]) -> Float[Array, " count"]:
    """The angles of markers on bodies whose points are `turned` by their modes [rad]."""
    return angles + turned[:, 0]


def turned(angles: Float[Array, " count"], turns: Float[Array, " count"]) -> Float[Array, " count"]:
    """The angles of markers turned by `turns` on points that are turned by `angles` themselves."""
    return angles + turns


def about(turns: Array, local: Array, rows: Sequence[tuple[int, ...]]) -> Array:
    """The `turns` of markers, which derivatives in the plane do not know."""
    del local, rows
    return turns


def compose(frame: Pose, local: Pose) -> Pose:
    """The poses of markers whose bodies have the poses `frame`."""
    return Pose(frame.position + _turn(frame.angle, local.position), frame.angle + local.angle)


def gradient(
    angle: Float[Array, " count"],
    local: Pose,
    turns: Float[Array, " count"],
    shapes: Float[Numbers, "count 3 modes"],
) -> PoseGradient:
    """The derivatives of `compose` by φ and amplitudes, for bodies at an `angle`."""
    del turns
    position = [_perpendicular(_turn(angle, local.position))[:, :, None]]
    turning = [jnp.ones((shapes.shape[0], 1), shapes.dtype)]
    if shapes.shape[2]:
        turned = jax.vmap(_turn, in_axes=(None, 2), out_axes=2)(angle, shapes[:, :2])
        position.append(turned)
        turning.append(shapes[:, 2])
    return PoseGradient(jnp.concatenate(position, axis=2), jnp.concatenate(turning, axis=1))


def _turn(angle: Float[Array, " count"], arm: Float[Array, "count 2"]) -> Float[Array, "count 2"]:
    return jnp.cos(angle)[:, None] * arm + jnp.sin(angle)[:, None] * _perpendicular(arm)


def _perpendicular(arm: Float[Array, "count 2"]) -> Float[Array, "count 2"]:
    return arm[:, ::-1] * np.array([[-1, 1]], arm.dtype)
