"""Surfaces that can be touched, by the distance of points from them. Their numbers are traced."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .curve import outside_of_round
from .drawing import arc, square
from .fields import Converted, check_numbers, number


class AbstractSurface(eqx.Module):
    """The surface of a solid; subclass it with one `__call__` for one of your own."""

    @abc.abstractmethod
    def __call__(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        """The distance [m] of a point from the surface, negative inside the solid."""

    def outline(
        self, point: Float[Array, "3"], size: Float[Array, ""]
    ) -> tuple[Float[Array, "points d"], ...]:
        """Lines on the surface for pictures, near a `point` [m]; none unless said.

        Flat ones are at z = 0. `size` [m] is that of signs.
        """
        del point, size
        return ()

    @abc.abstractmethod
    def check(self, owner: str) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""


class Plane(AbstractSurface):
    """The plane z = 0, with the solid below."""

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        return point[2]

    def outline(
        self, point: Float[Array, "3"], size: Float[Array, ""]
    ) -> tuple[Float[Array, "points d"], ...]:
        return (square(point, 2 * size),)

    def check(self, owner: str) -> None:
        del owner


class Cylinder(AbstractSurface):
    """A cylinder about the z axis without ends, of this `radius` [m]; the solid is around it where
    it is `hollow`, as a tube is.
    """

    radius: Converted[Float[Array, ""]] = number()
    hollow: bool = eqx.field(static=True, default=False)

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        return outside_of_round(point[:2], self.radius, self.hollow)

    def outline(
        self, point: Float[Array, "3"], size: Float[Array, ""]
    ) -> tuple[Float[Array, "points d"], ...]:
        height = point[2] + 4 * size * np.linspace(-1, 1, 3)
        rim = _circle(self.radius, (0, 1))
        return tuple(rim.at[:, 2].add(z) for z in height)

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", sign="positive", prefix="Cylinder.")


class Sphere(AbstractSurface):
    """A sphere of this `radius` [m]; the solid is around it where it is `hollow`, as a bowl is."""

    radius: Converted[Float[Array, ""]] = number()
    hollow: bool = eqx.field(static=True, default=False)

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        return outside_of_round(point, self.radius, self.hollow)

    def outline(
        self, point: Float[Array, "3"], size: Float[Array, ""]
    ) -> tuple[Float[Array, "points d"], ...]:
        del point, size
        return tuple(_circle(self.radius, plane) for plane in ((0, 1), (1, 2), (2, 0)))

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", sign="positive", prefix="Sphere.")


class Capsule(AbstractSurface):
    """A rod with round ends about the z axis, whose middle is the origin: what is within a `radius`
    of a segment of a `length` between the centres of the ends [m].
    """

    radius: Converted[Float[Array, ""]] = number()
    length: Converted[Float[Array, ""]] = number()

    def __call__(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        half = 0.5 * self.length
        foot = jnp.clip(point[2], -half, half)
        return outside_of_round(point.at[2].add(-foot), self.radius, False)

    def outline(
        self, point: Float[Array, "3"], size: Float[Array, ""]
    ) -> tuple[Float[Array, "points d"], ...]:
        del point, size
        rim, half = _circle(self.radius, (0, 1)), 0.5 * self.length
        sides = [_circle(self.radius, (axis, 2)) for axis in (0, 1)]
        long = [side.at[:, 2].add(jnp.where(side[:, 2] < 0, -half, half)) for side in sides]
        return rim.at[:, 2].add(half), rim.at[:, 2].add(-half), *long

    def check(self, owner: str) -> None:
        check_numbers(owner, self, "radius", "length", sign="positive", prefix="Capsule.")


def _circle(radius: Float[Array, ""], plane: tuple[int, int]) -> Float[Array, "points 3"]:
    """A circle about the origin in the plane of two axes."""
    return arc(radius, 2 * np.pi) @ np.eye(3)[list(plane)]
