"""Torques that the inertia of sections asks for in beams in space."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..linalg import quaternions
from ..scene.marker import Pose, Twist


def by_poses(gyration: Array, poses: Pose, twists: Twist, accelerations: Twist) -> Array:
    """The rates of the angular momentum of sections per mass, (points, 3).

    `gyration`: the inertia of sections about their axes per mass [m²].
    """
    axes = quaternions.matrix(poses.turn)
    spin, turning = (
        quaternions.apply_transposed(axes, x.angular_velocity) for x in (twists, accelerations)
    )
    own = gyration[None] * turning + quaternions.cross(spin, gyration[None] * spin)
    return quaternions.apply(axes, own)


def by_amplitudes(
    gyration: Array, tilts: Array, bends: bool, q: Array, v: Array, a: Array
) -> Array:
    """The same of a beam in space, whose sections turn by small angles against its frame: by the
    angular momentum that its inertia has, to the second order where they turn as the beam bends,
    and else with torsion alone, about the axis of the frame (`beam_inertia`).

    `tilts`: their angles per unit amplitude, (points, 3, modes).
    """
    frame, cross, gyration = np.s_[3:7], quaternions.cross, gyration[None]

    def momentum(spin: Array, bent: Array, bending: Array) -> Array:
        tilt, rate = tilts @ bent, tilts @ bending
        spin = jnp.broadcast_to(spin, tilt.shape)
        if not bends:
            return gyration * (spin + rate * np.array([[1.0, 0.0, 0.0]]))
        own, turned = gyration * spin, cross(tilt, spin)
        of_frame = own + cross(tilt, own) - gyration * turned - cross(tilt, gyration * turned)
        of_frame += 0.5 * (cross(tilt, cross(tilt, own)) + gyration * cross(tilt, turned))
        moving = gyration * rate
        return of_frame + moving + cross(tilt, moving) - 0.5 * gyration * cross(tilt, rate)

    spin, turning = jax.jvp(
        quaternions.body_angular_velocity, (q[frame], v[frame]), (v[frame], a[frame])
    )
    held, rate = jax.jvp(momentum, (spin, q[7:], v[7:]), (turning, v[7:], a[7:]))
    rate += cross(jnp.broadcast_to(spin, held.shape), held)
    return quaternions.rotate(jnp.broadcast_to(q[frame], (*held.shape[:-1], 4)), rate)
