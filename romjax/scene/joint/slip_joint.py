"""Joints that hold velocities: rolling without slip, knife edges, skates."""

import abc
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..marker import Pose, Poses, Twists
from .base import AbstractJoint


class AbstractSlipJoint(AbstractJoint):
    """A joint with non-holonomic rows, A(q) v = 0: velocities that are zero where it holds.

    It sets `slips`, the numbers of these rows, which come last, and `slip`, their velocities, which
    are linear in the twists. Rows before them are those of `height`, zero where the joint holds.

    A row of velocities is no function of positions. As a residual it is one whose value is zero and
    whose derivative along a motion is A v, and along accelerations A a + (A v)_q v, so that
    Jacobian, multipliers, projection of velocities and Baumgarte's term in their rate are those of
    any joint.
    """

    def residual(self, t: Time, a: Pose, b: Pose, *others: Pose) -> Float[Array, " rows"]:
        del t
        poses = (a, b, *others)
        return jnp.concatenate([self.height(*poses), _held(self, poses)])

    def height(self, *poses: Pose) -> Float[Array, " holonomic"]:
        """Lengths and angles that are zero where the joint holds; none unless a kind has some."""
        return jnp.zeros(0, poses[0].position.dtype)

    @abc.abstractmethod
    def slip(self, poses: Poses, twists: Twists) -> Float[Array, " slips"]:
        """Velocities that are zero where the joint holds, linear in the twists [m/s]."""


@jax.custom_jvp
def _held(joint: Any, poses: Poses) -> Float[Array, " slips"]:
    # Zero, as a product: of a constant, vmap would not see that its derivative is mapped over.
    return jnp.full(len(joint.slips), 0 * poses[0].position[0])


@_held.defjvp
def _along(primals: Any, tangents: Any) -> tuple[Array, Array]:
    joint, poses = primals
    rates = tangents[1]
    twists = tuple(pose.twist(Pose(*rate)) for pose, rate in zip(poses, rates, strict=True))
    along = joint.slip(poses, twists)
    # The value stays zero, and nothing follows from it in second derivatives.
    return jnp.full(len(joint.slips), 0 * poses[0].position[0]), along
