"""A wheel that rolls on a curve in the plane."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...linalg.plane import perpendicular
from ..curve import AbstractCurve
from ..drawing import arc, placed
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists
from ..outline import Outline, Outlines
from .slip_joint import AbstractSlipJoint


class RollingWheel(AbstractSlipJoint):
    """A wheel that rolls without slip on a `curve` in the frame of marker `b`, such as a `Line`, a
    `Circle` or a `Polynomial`: it touches the curve, and the point of its rim that does so has no
    velocity against `b`.

    **Arguments:**

    - `a`: the centre of the wheel.
    - `b`: carries the curve.
    - `curve`: it is on the side of positive values of that: outside of a circle, above a line, and
      inside of a hollow circle.
    - `radius` [m]: smaller than that of the curve where that is bent towards the wheel.

    The second of its two rows is a constraint of velocities. Raises SceneError for a radius that is
    not positive.
    """

    a: Marker
    b: Marker
    curve: AbstractCurve
    radius: Converted[Float[Array, ""]] = number()
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2
    slips: ClassVar[tuple[int, ...]] = (1,)

    def height(self, *poses: Pose) -> Float[Array, "1"]:
        a, b = poses
        centre = b.local(a.position)
        foot, normal = self._foot(centre)
        return (normal @ (centre - foot) - self.radius)[None]

    def slip(self, poses: Poses, twists: Twists) -> Float[Array, "1"]:
        (a, b), (of_a, of_b) = poses, twists
        foot, normal = self._foot(b.local(a.position))
        touching = b.position + b.turned(foot)
        # The direction of rolling: the tangent of the curve.
        along = b.turned(jnp.stack([normal[1], -normal[0]]))
        # The velocities of both bodies at the point where they touch: v + ω × r.
        own, other = (
            twist.velocity + twist.angular_velocity * perpendicular(touching - pose.position)
            for pose, twist in ((a, of_a), (b, of_b))
        )
        return (along @ (own - other))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The curve, and the rim with a spoke, which shows how it turns."""
        del t
        a, b = poses
        track = placed(b, self.curve.outline(b.local(a.position), size))
        rim = jnp.concatenate([jnp.zeros((1, 2)), arc(self.radius, 2 * np.pi, 49)])
        return (
            Outline(track, "track", endless=self.curve.endless),
            Outline(placed(a, rim), "link"),
        )

    def check(self) -> None:
        super().check()
        self.curve.check(self.owner())
        check_numbers(self.owner(), self, "radius", sign="positive")

    def _foot(self, centre: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
        """The point of the curve nearest to a centre, and the direction there out of it."""
        foot = self.curve.foot(centre)
        # The gradient of the function that is zero on the curve is normal to it.
        slope = jax.grad(self.curve)(foot)
        return foot, slope / jnp.sqrt(slope @ slope)
