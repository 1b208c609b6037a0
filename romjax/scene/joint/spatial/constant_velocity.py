"""A constant-velocity joint."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ....linalg import quaternions
from ...drawing import axis_line
from ...marker import Marker, Pose, Poses
from ...outline import Outline, Outlines, marks
from ..base import AbstractJoint


class ConstantVelocity(AbstractJoint):
    """The two markers stay at one position, and no rotation about the z axis is between them: at
    any angle, shafts along their z axes turn equally fast.

    The rotation from `b` to `a` is one about an axis across both shafts, so that each is the mirror
    image of the other in the plane that bisects them (Hunt, "Constant-Velocity Shaft Couplings: A
    General Theory", J. Eng. Ind. 95, 1973).
    """

    a: Marker
    b: Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 4
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = (("x", "rad"), ("y", "rad"))

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "4"]:
        del t
        twist = a.angle_against(b)
        return jnp.append(a.position - b.position, twist)

    def place(self, z: Float[Array, "2"]) -> Pose:
        # Without a rotation about z the third entry is zero: these quaternions are multiples of
        # (1, ½ x, ½ y, 0), which passes no half turn.
        turn = quaternions.small_turn(jnp.append(z, 0))
        return Pose(jnp.zeros(3, z.dtype), turn / jnp.sqrt(quaternions.squared(turn)))

    def screws(self, z: Float[Array, "2"]) -> Float[Array, "2 6"]:
        # By Rodrigues' parameters ρ = z/2, ω = 2 (ρ̇ + ρ × ρ̇) / (1 + ρ²).
        x, y = 0.5 * z
        none, one = jnp.zeros_like(x), jnp.ones_like(x)
        rows = jnp.stack([jnp.stack([one, none, -y]), jnp.stack([none, one, x])])
        return jnp.pad(rows / (1 + x**2 + y**2), ((0, 0), (0, 3)))

    def read(self, a: Pose, b: Pose) -> Float[Array, "2"]:
        relative = a.against(b).turn
        return 2 * relative[1:3] / relative[0]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        shafts = [Outline(axis_line(pose, size), "link") for pose in poses]
        return *shafts, marks(poses)
