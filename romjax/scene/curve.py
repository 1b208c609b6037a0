"""Curves: where a number that depends on a point is zero. Their parameters are traced."""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Vector
from ..linalg.dense import invert, length, multiply
from .drawing import REACH, arc, follow
from .fields import Converted, check_numbers, number

# Newton's steps to a foot, which double the digits: half of them at least while it is far away.
_STEPS = 12
# Those among them that derivatives pass through: k of them give derivatives of the order 2ᵏ − 1.
_DIFFERENTIATED = 2


class AbstractTrack(eqx.Module):
    """The base of curves in the plane and in space, to which a point can be held."""

    # Whether pictures show only a part of it.
    endless: ClassVar[bool] = True

    @abc.abstractmethod
    def __call__(self, point: Float[Array, " d"]) -> Float[Array, "*less"]:
        """Return residuals, zero on the curve [m]."""

    def outline(
        self, point: Float[Array, " d"], size: Float[Array, ""]
    ) -> Float[Array, "points d"]:
        """Points of the curve for pictures, to both sides of the foot of `point` [m].

        `size` [m] is that of signs.
        """
        return follow(lambda point: jnp.atleast_1d(self(point)), point, size)

    @abc.abstractmethod
    def check(self, owner: str) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""


class AbstractCurve(AbstractTrack):
    """Points with a residual of zero; subclass it with one `__call__` for a curve of your own."""

    @abc.abstractmethod
    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """Return zero on the curve [m], negative numbers inside; its gradient is not zero there."""

    def distance(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """How far a point is outside [m], negative inside: the residual, which `Contact` divides
        by its slope, unless a kind has the distance in closed form.
        """
        return self(point)

    def foot(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        """The point of the curve nearest to a point [m]: p with f(p) = 0 and p + λ ∇f(p) = `point`,
        by Newton's method, unless a kind has it in closed form.

        Derivatives pass through its last steps alone; what is before them is a guess, on which the
        foot does not depend.
        """
        value, slope = jax.value_and_grad(self)(point)
        # Unknowns are the foot and the multiplier of f = 0: the point is the foot plus a multiple
        # of the normal there.
        start = jnp.append(point, value / (slope @ slope))
        # At the solution each of Newton's steps has the derivatives of the solution, of a higher
        # order each.
        curve, still, x = jax.lax.stop_gradient((self, point, start))
        free = _STEPS - _DIFFERENTIATED
        x, _ = jax.lax.scan(lambda x, _: (_nearer(curve, still, x), None), x, None, length=free)
        for _ in range(_DIFFERENTIATED):
            x = _nearer(self, point, x)
        return x[:2]


class Line(AbstractCurve):
    """The x axis."""

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return point[1]

    def foot(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        return point.at[1].set(0.0)

    def outline(self, point: Float[Array, "2"], size: Float[Array, ""]) -> Float[Array, "points 2"]:
        along = point[0] + REACH * size * np.array([-1.0, 1.0])
        return jnp.stack([along, jnp.zeros_like(along)], axis=1)

    def check(self, owner: str) -> None:
        del owner


class Circle(AbstractCurve):
    """x² + y² = `radius`² [m]; what is solid is around it where it is `hollow`, as a hole is."""

    radius: Converted[Float[Array, ""]] = number()
    hollow: bool = eqx.field(static=True, default=False)
    endless: ClassVar[bool] = False

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        outside = (point @ point - self.radius**2) / (2 * self.radius)
        return -outside if self.hollow else outside

    def distance(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return outside_of_round(point, self.radius, self.hollow)

    def foot(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        return self.radius / jnp.sqrt(point @ point) * point

    def outline(self, point: Float[Array, "2"], size: Float[Array, ""]) -> Float[Array, "points 2"]:
        del point, size
        return arc(self.radius, 2 * np.pi, 97)

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", sign="positive", prefix="Circle.")


class Polynomial(AbstractCurve):
    """y = c₀ + c₁ x + c₂ x² + … by its `coefficients` [m^(1−k)]."""

    coefficients: Converted[Float[Array, " k"], Vector] = number()

    def __call__(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return point[1] - jnp.polyval(self.coefficients[::-1], point[0])

    def distance(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """To the foot where a point is inside; of first order outside, where that may be far."""
        height = self(point)
        inside = height < 0
        # Outside, a point of the curve stands in, where Newton's method has nothing to do.
        near = jnp.where(inside, point, point.at[1].add(-height))
        x = self._below(near)
        deep = self._normal(x) @ (near - self._at(x))
        return jnp.where(inside, deep, self._normal(point[0])[1] * height)

    def _below(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """The x of the foot, by Newton's method in it alone from where the curve is above or below;
        differentiated as `foot` is.
        """

        def nearer(x: Array, curve: "Polynomial", point: Array) -> Array:
            def slope(x: Array) -> Array:
                found: Array = jax.grad(lambda x: 0.5 * jnp.sum((point - curve._at(x)) ** 2))(x)
                return found

            value, bend = jax.jvp(slope, (x,), (jnp.ones_like(x),))
            after: Array = x - value / bend
            return after

        curve, still = jax.lax.stop_gradient((self, point))
        free = _STEPS - _DIFFERENTIATED
        x, _ = jax.lax.scan(
            lambda x, _: (nearer(x, curve, still), None), still[0], None, length=free
        )
        for _ in range(_DIFFERENTIATED):
            x = nearer(x, self, point)
        return x

    def _normal(self, x: Float[Array, ""]) -> Float[Array, "2"]:
        slope = jax.grad(lambda x: self._at(x)[1])(x)
        return jnp.stack([-slope, jnp.ones_like(slope)]) / jnp.sqrt(1 + slope**2)

    def _at(self, x: Float[Array, ""]) -> Float[Array, "2"]:
        return jnp.stack([x, jnp.polyval(self.coefficients[::-1], x)])

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "coefficients", shape=(None,), prefix="Polynomial.")


def outside_of_round(
    arm: Float[Array, " k"], radius: Float[Array, ""], hollow: bool
) -> Float[Array, ""]:
    """The distance from a round curve or surface, from the arm that its centre or axis has to a
    point; negative inside of what is solid.
    """
    # In the centre there is no way out, and no force.
    return radius - length(arm) if hollow else length(arm) - radius


def _nearer(
    curve: AbstractCurve, point: Float[Array, "2"], x: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Newton's step of p and λ."""

    def residual(x: Float[Array, "3"]) -> Float[Array, "3"]:
        value, slope = jax.value_and_grad(curve)(x[:2])
        return jnp.append(x[:2] + x[2] * slope - point, value)

    return x - multiply(invert(jax.jacfwd(residual)(x)), residual(x))
