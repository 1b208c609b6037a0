"""A knife edge, or a skate."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...linalg.plane import perpendicular
from ..drawing import placed
from ..marker import Marker, Poses, Twists
from ..outline import Outline, Outlines
from .slip_joint import AbstractSlipJoint


class KnifeEdge(AbstractSlipJoint):
    """Marker `a` moves on `b` along its own x axis alone, as a skate on ice, or a wheel that rolls
    upright: its velocity against `b` across that axis is zero.

    A constraint of velocities (non-holonomic): any place can be reached.
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    slips: ClassVar[tuple[int, ...]] = (0,)

    def slip(self, poses: Poses, twists: Twists) -> Float[Array, "1"]:
        (a, b), (of_a, of_b) = poses, twists
        arm = a.position - b.position
        # The point of `b` that is under `a` moves with the turning of `b` too.
        turned = of_b.angular_velocity * perpendicular(arm)
        velocity = of_a.velocity - of_b.velocity - turned
        across = jnp.cos(a.angle) * velocity[1] - jnp.sin(a.angle) * velocity[0]
        return across[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The edge."""
        del t
        edge = jnp.array([[-0.5, 0.0], [0.5, 0.0]]) * size
        return (Outline(placed(poses[0], edge), "link"),)
