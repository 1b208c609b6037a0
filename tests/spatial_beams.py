"""A beam in space, and small motions about a state, for closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from romjax import spatial
from romjax.linalg import quaternions

LENGTH, MASS, EI = 1.3, 0.7, 3.0


POLAR = 1e-5


# Of frequencies of a blade by six modes in each plane, against a basis of polynomials.
CONVERGED = 1e-3


def beam(**settings):
    across = MASS * LENGTH**2 / 12 + POLAR / 2
    settings = {"inertia": (POLAR, across, across), "EI": EI, "bending": 6, **settings}
    return spatial.Beam("beam", MASS, LENGTH, **settings)


def marker(body, q, point):
    """Where a material point of a body is, as a position and a quaternion."""
    bent, point = q[7:], jnp.asarray(point)
    moved = body.mode_shapes(point) @ bent
    arm = point + moved[:3]
    if body.foreshortens:
        arm -= 0.5 * (body.foreshortening(point) @ bent) @ bent
    turn = quaternions.product(q[3:7], quaternions.small_turn(moved[3:]))
    return q[:3] + quaternions.rotate(q[3:7], arm), turn


def clamped(body, bent):
    """The coordinates of a beam whose lower end is clamped at the origin."""
    level = jnp.concatenate([jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), bent])
    start = (-body.length / 2, 0.0, 0.0)
    _, turn = marker(body, level, start)
    turned = level.at[3:7].set(quaternions.conjugate(turn))
    place, _ = marker(body, turned, start)
    return turned.at[:3].set(-place)


def turning(q, v, spin):
    """The velocities of a body, given those against axes that turn by `spin`."""
    about = jnp.concatenate([jnp.cross(spin, q[:3]), quaternions.derivative(q[3:7], spin)])
    return v.at[:7].add(about)


def small_motion(lagrangian, count):
    """M, G and K of M a + G v + K x = 0 about the origin of a Lagrangian of x and v."""
    slopes = jax.hessian(lambda state: lagrangian(*jnp.split(state, 2)))(jnp.zeros(2 * count))
    coupling = slopes[count:, :count]
    return slopes[count:, count:], coupling - coupling.T, -slopes[:count, :count]


def rates(mass, gyroscopic, stiffness):
    """Angular frequencies of small motions."""
    count = len(mass)
    above = np.hstack([np.zeros((count, count)), np.eye(count)])
    below = -np.linalg.inv(mass) @ np.hstack([stiffness, gyroscopic])
    return np.sort(np.abs(scipy.linalg.eigvals(np.vstack([above, below])).imag))[::2]
