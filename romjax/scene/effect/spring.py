"""A spring between two points."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..drawing import zigzag
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses
from ..outline import Outline, Outlines
from .base import AbstractPotential, check_markers


class Spring(AbstractPotential):
    """A spring between two markers, with the energy ½ k s² + ¼ k₃ s⁴ of its stretch s.

    Without a rest length s is the distance |Δ|: the same stiffness in x and in y, smooth where the
    points meet (the chapter's cart). With one it is |Δ| − rest, along the line between the points.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: k [N/m].
    - `rest_length`: unstretched length [m]; none unless given.
    - `cubic`: k₃ [N/m³], which hardens the spring; none unless given.
    """

    a: Marker
    b: Marker
    stiffness: Converted[Float[Array, ""]] = number()
    rest_length: Converted[Float[Array, ""] | None] = number(default=None)
    cubic: Converted[Float[Array, ""] | None] = number(default=None)
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    hatched: ClassVar[bool] = True
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        a, b = poses
        squared = jnp.sum((a.position - b.position) ** 2)
        if self.rest_length is not None:
            # (|Δ| − L)² = |Δ|² − 2 L |Δ| + L². The gradient of |Δ| is NaN where the points meet:
            # its term is left out there, so that a rest length pushes in no direction, and one of
            # zero, traced or not, gives the force k Δ and the stiffness k everywhere.
            apart = squared > 0
            length = jnp.sqrt(jnp.where(apart, squared, 1.0))
            met = squared + self.rest_length**2
            squared = jnp.where(apart, (length - self.rest_length) ** 2, met)
        energy = 0.5 * self.stiffness * squared
        return energy if self.cubic is None else energy + 0.25 * self.cubic * squared**2

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, b = poses
        return (Outline(zigzag(a.position, b.position, size), "spring"),)

    def check(self) -> None:
        fields = ("stiffness", "rest_length", "cubic")
        check_numbers(check_markers(self), self, *fields, sign="not negative")
