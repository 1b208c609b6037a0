"""Curves: where a number that depends on a point is zero. Their parameters are traced."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Vector
from .fields import Converted, check_numbers, number


class AbstractCurve(eqx.Module):
    """Points with a residual of zero; subclass it with one `__call__` for a curve of your own."""

    @abc.abstractmethod
    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """Zero on the curve [m], with a gradient that is not zero there; negative inside."""

    @abc.abstractmethod
    def check(self, owner: str) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""


class Line(AbstractCurve):
    """The x axis."""

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return point[1]

    def check(self, owner: str) -> None:
        del owner


class Circle(AbstractCurve):
    """x² + y² = `radius`² [m]."""

    radius: Converted[Float[Array, ""]] = number()

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return (point @ point - self.radius**2) / (2 * self.radius)

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", sign="positive", prefix="Circle.")


class Polynomial(AbstractCurve):
    """y = c₀ + c₁ x + c₂ x² + … by its `coefficients` [m^(1−k)]."""

    coefficients: Converted[Float[Array, " k"], Vector] = number()

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return point[1] - jnp.polyval(self.coefficients[::-1], point[0])

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "coefficients", shape=(None,), prefix="Polynomial.")
