"""Two joints that move together."""

import functools
import operator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector
from ..fields import Converted, check_finite, check_shape, number
from ..marker import Marker, Pose, Poses
from ..marker_checks import check_distinct
from ..motion import check_motion, moved
from ..outline import Outline, Outlines
from .base import AbstractJoint


class Coupling(AbstractJoint):
    """The motion of one joint is a polynomial of that of another: s_a = Σ_k c_k s_b^k.

    With two coefficients it is a gear, as `Gear` for hinges, or a rack and a pinion; with one, s_a
    is held. Angles of "angle" count full turns from between −π and π at the start.

    **Arguments:**

    - `a`, `bearing_a`: the markers of the first joint, the second of what carries it.
    - `b`, `bearing_b`: those of the other.
    - `coefficients`: c_0, c_1, … [rad], [m], and these per power of s_b.
    - `motion_a`, `motion_b`: what s_a and s_b are, as in `JointSpring`.
    """

    a: Marker
    b: Marker
    bearing_a: Marker
    bearing_b: Marker
    coefficients: Converted[Float[Array, " k"], Vector] = number()
    motion_a: str = eqx.field(static=True, default="angle")
    motion_b: str = eqx.field(static=True, default="angle")
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    hatched: ClassVar[bool] = False

    @property
    def counted(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]
        pairs = (self.motion_a, (0, 2)), (self.motion_b, (1, 3))
        return tuple(pair for motion, pair in pairs if motion == "angle")

    @property
    def markers(self) -> tuple[Marker, ...]:
        return self.a, self.b, self.bearing_a, self.bearing_b

    def residual(self, t: Time, a: Pose, b: Pose, *others: Pose) -> Float[Array, "1"]:
        del t
        bearing_a, bearing_b, *counters = others
        # Only angles have counters of full turns, so that up to two of them follow the bearings.
        own = counters[:1] if self.motion_a == "angle" else []
        other = counters[-1:] if self.motion_b == "angle" else []
        led = moved(self.motion_a, a, bearing_a, *own)
        leading = moved(self.motion_b, b, bearing_b, *other)
        powers = [self.coefficients[k] * leading**k for k in range(self.coefficients.shape[0])]
        return (led - functools.reduce(operator.add, powers))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A line between the two joints."""
        del t, size
        return (Outline(jnp.stack([pose.position for pose in poses[:2]]), "link"),)

    def check(self) -> None:
        owner = self.owner()
        super().check()
        check_distinct(owner, self.a, self.bearing_a)
        check_distinct(owner, self.b, self.bearing_b)
        check_motion(owner, self.motion_a, self.a.dimension)
        check_motion(owner, self.motion_b, self.a.dimension)
        check_shape(owner, "coefficients", self.coefficients, (None,))
        check_finite(owner, "coefficients", self.coefficients)
