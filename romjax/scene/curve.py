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
# Derivatives pass through so many of them: k give derivatives of the order 2ᵏ − 1.
_DIFFERENTIATED = 2
# The nearest point of a polynomial is sought over so many chords to each side of a point.
_CHORDS = 24
# A lower bound, a number and an upper bound.
_Bracket = tuple[Array, Array, Array]


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
        # Outside, a point of the curve stands in, which is its own foot.
        near = jnp.where(inside, point, point.at[1].add(-height))
        x = self._nearest(near)
        y, slope, _ = self._rise(x)
        deep = (near[1] - y - slope * (near[0] - x)) / jnp.sqrt(1 + slope**2)
        # Between a point and the nearest one of all is nothing of the curve; one that is only the
        # nearest of its neighbourhood may be seen from the other side.
        deep = jnp.where(deep > 0, -deep, deep)
        return jnp.where(inside, deep, height / jnp.sqrt(1 + self._rise(point[0])[1] ** 2))

    def _nearest(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """The x of the foot, by Newton's method over each of some chords, the nearest of what it
        finds; differentiated as `foot` is.

        The foot is no farther than the curve is above or below the point. Chords are the shorter
        the nearer, as steep curves have their feet at a small share of that.
        """
        curve, still = jax.lax.stop_gradient((self, point))
        shares = np.geomspace(1e-4, 1.0, _CHORDS)
        ends = still[0] + jnp.abs(curve(still)) * np.concatenate([-shares[::-1], [0.0], shares])
        tops = curve._rise(ends)[0]
        wide, high = jnp.diff(ends), jnp.diff(tops)
        # Chords have no length where the point is on the curve.
        squares = jnp.maximum(wide**2 + high**2, jnp.finfo(ends.dtype).tiny)
        along = (still[0] - ends[:-1]) * wide + (still[1] - tops[:-1]) * high
        start = ends[:-1] + jnp.clip(along / squares, 0.0, 1.0) * wide

        def nearer(bracket: _Bracket, _: None) -> tuple[_Bracket, None]:
            low, x, high = bracket
            slope, bend = curve._away(still, x)
            low, high = jnp.where(slope < 0, x, low), jnp.where(slope > 0, x, high)
            after = x - slope / bend
            within = (low <= after) & (after <= high)
            return (low, jnp.where(within, after, (low + high) / 2), high), None

        bracket = ends[:-1], start, ends[1:]
        found = jax.lax.scan(nearer, bracket, None, length=_STEPS)[0][1]
        squares = (found - still[0]) ** 2 + (curve._rise(found)[0] - still[1]) ** 2
        x = found[jnp.argmin(squares)]
        for _ in range(_DIFFERENTIATED):
            slope, bend = self._away(point, x)
            x = x - slope / bend
        return x

    def _away(
        self, point: Float[Array, "2"], x: Float[Array, "*k"]
    ) -> tuple[Float[Array, "*k"], Float[Array, "*k"]]:
        """The first two derivatives by x of half of the squared distance of a point.

        The second is zero where the point is the centre of curvature, so that the foot has no
        derivative: there it is a little of what it would be on a straight line.
        """
        y, slope, bend = self._rise(x)
        straight = 1 + slope**2
        second = straight + (y - point[1]) * bend
        least = np.cbrt(jnp.finfo(x.dtype).eps) * straight
        return x - point[0] + (y - point[1]) * slope, jnp.maximum(second, least)

    def _rise(self, x: Float[Array, "*k"]) -> tuple[Float[Array, "*k"], ...]:
        """The height of the curve at x, and its first two derivatives."""

        def height(x: Array) -> Array:
            return jnp.polyval(self.coefficients[::-1], x)

        def slope(x: Array) -> tuple[Array, Array]:
            both: tuple[Array, Array] = jax.jvp(height, (x,), (jnp.ones_like(x),))
            return both

        (y, first), (_, second) = jax.jvp(slope, (x,), (jnp.ones_like(x),))
        return y, first, second

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
