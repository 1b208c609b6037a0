"""Curves in space: where two numbers that depend on a point are zero. Their numbers are traced."""

import abc

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Vector, concrete
from ..common.errors import SceneError
from .curve import AbstractTrack
from .fields import Converted, check_numbers, number


class AbstractSpaceCurve(AbstractTrack):
    """Points with two residuals of zero; subclass it with one `__call__` for one of your own."""

    @abc.abstractmethod
    def __call__(self, point: Float[Array, "3"]) -> Float[Array, "2"]:
        """Return two residuals, zero on the curve [m], with independent gradients there."""


class Helix(AbstractSpaceCurve):
    """x = R cos θ, y = R sin θ with θ = 2π z / pitch, about the z axis.

    **Arguments:**

    - `radius`: R [m]. `pitch`: of a turn [m], not zero; positive for a right-handed helix.
    """

    radius: Converted[Float[Array, ""]] = number()
    pitch: Converted[Float[Array, ""]] = number()

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, "2"]:
        angle = 2 * np.pi * point[2] / self.pitch
        return point[:2] - self.radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", sign="positive", prefix="Helix.")
        check_numbers(owner, self, "pitch", prefix="Helix.")
        if concrete(self.pitch) == 0:
            raise SceneError(f"{owner}: Helix.pitch is 0; use romjax.Circle for a flat one.")


class SpacePolynomial(AbstractSpaceCurve):
    """(x, y) = c₀ + c₁ z + c₂ z² + … by its `coefficients` (k, 2) [m^(1−k)]."""

    coefficients: Converted[Float[Array, "k 2"], Vector] = number()

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, "2"]:
        return point[:2] - jnp.polyval(self.coefficients[::-1], point[2])

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "coefficients", shape=(None, 2), prefix="SpacePolynomial.")
