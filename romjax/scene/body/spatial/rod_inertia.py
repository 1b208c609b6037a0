"""The inertia of a rod in space, by its Gauss points."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....linalg import magnus, quaternions
from .rod_kinematics import Line, columns, motion, sections, turning


def mass_matrix(line: Line, mass: Any, rotary: Any, q: Float[Array, " size"]) -> Array:
    """∫ρ JᵀJ of the points and of the turning of sections with the `rotary` inertia (3,) [kg m]
    about their axes, and the inertia of the length of the quaternion.
    """
    _, moved, turned = jacobian(line, q)
    weights = line.strains.weights()[:, None, None]
    size = moved.shape[2]
    own = [mass * weights * moved, line.length * weights * rotary[None, :, None] * turned]
    total = sum(
        x.reshape(-1, size).T @ y.reshape(-1, size)
        for x, y in zip(own, (moved, turned), strict=True)
    )
    p = q[3:7]
    along = length_inertia(line, mass, rotary) / quaternions.squared(p) ** 2 * p[:, None] * p[None]
    padded: Array = total + jnp.pad(along, ((3, size - 7), (3, size - 7)))
    return padded


def velocity_force(
    line: Line, mass: Any, rotary: Any, q: Float[Array, " size"], v: Float[Array, " size"]
) -> Float[Array, " size"]:
    """−∫ρ Jᵀ r̈ at q̈ = 0, and the same of the turning of sections."""
    cross = magnus.cross
    p, rate = q[3:7], v[3:7]
    s, r = quaternions.squared(p), jnp.sum(p * rate)
    position, moved, turned = jacobian(line, q)
    at = sections(line, q[7:])
    own = motion(line, at, v[7:])
    # The rate of ω = 2 G ṗ/s, in which Ġ ṗ is zero.
    omega = quaternions.body_angular_velocity(p, rate)[None]
    alpha = -2 * r / s * omega
    acceleration = cross(alpha, position) + own.acceleration
    acceleration += cross(omega, cross(omega, position) + 2 * own.rate)
    turns = own.spinning + alpha + cross(omega, own.spin)
    axes = at.axes[1:]
    spin = quaternions.apply_transposed(axes, omega + own.spin)
    momentum = rotary[None] * spin
    torque = rotary[None] * quaternions.apply_transposed(axes, turns) + cross(spin, momentum)
    weights = line.strains.weights()[:, None]
    forces = (mass * weights * acceleration, moved), (line.length * weights * torque, turned)
    total: Array = -sum(x.reshape(-1) @ y.reshape(-1, q.size) for x, y in forces)
    length = length_inertia(line, mass, rotary) * (2 * r**2 / s - jnp.sum(rate**2)) / s**2 * p
    return total + jnp.pad(length, (3, q.size - 7))


def jacobian(
    line: Line, q: Float[Array, " size"]
) -> tuple[Float[Array, "points 3"], Float[Array, "points 3 size"], Float[Array, "points 3 size"]]:
    """Positions of the Gauss points in the frame, the derivatives of the inertial ones by all
    coordinates along the axes of the frame, and the turns of sections along their own axes.
    """
    own, at = line.strains, sections(line, q[7:])
    to = line.length * own.positions()
    position = line.origin()[None] + to @ at.slope
    turned = turning(at)
    moved = columns(line, at, turned)
    p, shape = q[3:7], (own.points, 3)
    # ω = onto ṗ by the axes of the frame, in which all rows are.
    onto = 2 * quaternions.body_matrix(p) / quaternions.squared(p)
    along = jnp.broadcast_to(quaternions.matrix(p).T, (*shape, 3))
    around = -magnus.skew(position) @ onto
    integrals = (to @ moved.reshape(own.points, -1)).reshape(moved.shape)
    both = jnp.concatenate([jnp.broadcast_to(onto, (*shape, 4)), turned], axis=2)
    tilted = jnp.swapaxes(at.axes[1:], 1, 2) @ both
    still = np.zeros((*shape, 3), q.dtype)
    return (
        position,
        jnp.concatenate([along, around, integrals], axis=2),
        jnp.concatenate([still, tilted], axis=2),
    )


def first_moment(line: Line, mass: Any, q: Float[Array, " size"]) -> Float[Array, "3"]:
    """∫ρ r [kg m]."""
    own = line.strains
    mean = (own.positions().T @ own.weights()) @ sections(line, q[7:]).slope
    moment: Array = mass * (q[:3] + quaternions.rotate(q[3:7], line.origin() + line.length * mean))
    return moment


def first_moment_slope(line: Line, mass: Any, q: Float[Array, " size"]) -> Float[Array, "3 size"]:
    """Its derivative: the mean of those of the Gauss points, which the mass matrix is made of."""
    _, moved, _ = jacobian(line, q)
    mean = (line.strains.weights() @ moved.reshape(len(moved), -1)).reshape(moved.shape[1:])
    slope: Array = mass * (quaternions.matrix(q[3:7]) @ mean)
    return slope


def length_inertia(line: Line, mass: Any, rotary: Any) -> Any:
    """The inertia of the length of the quaternion, as of a rigid body: that of the straight rod."""
    # tr J of a straight rod is twice m L² / 12 and the rotary inertia of its sections.
    return 4 / 3 * (mass * line.length**2 / 6 + line.length * jnp.sum(rotary))
