"""A linear viscous damper."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import dashpot
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Poses, Twists
from ..outline import Outline, Outlines
from .base import AbstractDissipation, check_markers


class Damper(AbstractDissipation):
    """A viscous damper between two markers, with the same constant in x and in y: R = ½ d |Δv|².

    With `along_line` it resists only the change of the distance: R = ½ d (Δv · e)², where e is the
    unit vector between the points; there is no force where they meet.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `damping`: d [N s/m].
    - `along_line`: whether it acts only along the line between the points.
    """

    a: Marker
    b: Marker
    damping: Converted[Float[Array, ""]] = number()
    along_line: bool = eqx.field(static=True, default=False)
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    hatched: ClassVar[bool] = True
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def rayleigh(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        del t
        a, b = twists
        if self.along_line:
            line = poses[0].position - poses[1].position
            squared = jnp.sum(line**2)
            # The gradient of a length is NaN at zero; there the line has no direction, and e is 0.
            e = line / jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
            return 0.5 * self.damping * (e @ (a.velocity - b.velocity)) ** 2
        return 0.5 * self.damping * jnp.sum((a.velocity - b.velocity) ** 2)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        parts = dashpot(a.position, b.position, size)
        return tuple(Outline(points, "damper") for points in parts)

    def check(self) -> None:
        check_numbers(check_markers(self), self, "damping", sign="not negative")
