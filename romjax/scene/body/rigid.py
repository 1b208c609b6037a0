"""A rigid body."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Number, Vector
from ..drawing import disc, rectangle
from ..fields import (
    Converted,
    check_mass,
    check_numbers,
    check_shape,
    number,
    radians,
)
from ..points import NamedPoints, by_name
from .base import AbstractBody, check_name, check_start, frame_start


class RigidBody(AbstractBody):
    """A rigid body with its frame in the centre of mass, unless `com` is given; coordinates x, y
    [m], φ [rad].

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg].
    - `inertia`: Moment of inertia about the centre of mass [kg m²].
    - `position`, `angle`: initial pose of the frame [m], [rad].
    - `velocity`, `angular_velocity`: initial motion [m/s], [rad/s].
    - `extent`: what it is drawn as, without mechanical meaning: length and height [m] of a
      rectangle, the diameter of a disc, or the corners of a polygon (corners, 2).
    - `points`: points by name for `body.at("name")`, such as {"pin": (0.1, 0.0)} [m].
    - `com`: the centre of mass in the frame of the body [m], where that is another point: position,
      velocity, points, `extent` and `at` are those of the frame, and coordinates and inertia those
      of the centre of mass by its axes.
    """

    name: str = eqx.field(static=True)
    mass: Converted[Float[Array, ""]] = number()
    inertia: Converted[Float[Array, ""]] = number()
    position: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angle: Converted[Float[Array, ""]] = radians(default=0.0)
    velocity: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angular_velocity: Converted[Float[Array, ""]] = number(default=0.0)
    extent: Converted[Float[Array, "*shape"], Vector | Number] = number(default=(0.2, 0.1))
    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())
    com: Converted[Float[Array, "2"] | None, Vector | None] = number(default=None)
    modes: ClassVar[int] = 0  # type: ignore[misc]

    @property
    def centre(self) -> Float[Array, "2"] | None:
        return self.com

    @property
    def constant_mass(self) -> bool:
        return True

    def start(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        return frame_start(self)

    def named_points(self) -> Mapping[str, Float[Array, "2"]]:
        return self.points.mapping()

    def mass_matrix(self, q: Float[Array, "3"]) -> Float[Array, "3"]:
        del q
        return jnp.stack([self.mass, self.mass, self.inertia])

    def elastic_energy(self, q: Float[Array, "3"]) -> Float[Array, ""]:
        return jnp.zeros((), q.dtype)

    def first_moment(self, q: Float[Array, "3"]) -> Float[Array, "2"]:
        return self.mass * q[:2]

    def mode_shapes(self, point: Float[Array, "2"]) -> Float[Array, "3 0"]:
        return jnp.zeros((3, 0), point.dtype)

    def outline(self) -> Float[Array, "points 2"]:
        if self.extent.ndim == 2:
            return jnp.concatenate([self.extent, self.extent[:1]])
        return rectangle(self.extent) if self.extent.ndim else disc(self.extent)

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        remedy = "Give a point mass a small inertia."
        check_mass(owner, self)
        check_numbers(owner, self, "inertia", sign="positive", remedy=remedy)
        if self.extent.ndim:
            polygon = self.extent.ndim == 2
            check_shape(owner, "extent", self.extent, (None, 2) if polygon else (2,))
        check_start(owner, self)
        self.points.check(owner)
