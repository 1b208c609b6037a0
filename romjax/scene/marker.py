"""Markers: the only connectors between bodies, joints and effects."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Number, Vector, as_array
from ..errors import SceneError
from .fields import Converted, check_finite, check_shape, number, radians
from .points import NamedPoints, by_name, point_of

GROUND = "ground"


class Pose(NamedTuple):
    """Where a marker is: its `position` [m] and `angle` [rad]."""

    position: Float[Array, "2"]  # [m]
    angle: Float[Array, ""]  # [rad]

    def along(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """The local x of a point of the inertial frame [m]."""
        return jnp.stack([jnp.cos(self.angle), jnp.sin(self.angle)]) @ (point - self.position)

    def across(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """The local y of a point of the inertial frame [m]."""
        return jnp.stack([-jnp.sin(self.angle), jnp.cos(self.angle)]) @ (point - self.position)

    def local(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        """A point of the inertial frame in the marker's own [m]."""
        return jnp.stack([self.along(point), self.across(point)])

    def turned(self, vector: Float[Array, "2"]) -> Float[Array, "2"]:
        """A vector of the marker's frame in the inertial one."""
        across = jnp.stack([-vector[1], vector[0]])
        return jnp.cos(self.angle) * vector + jnp.sin(self.angle) * across


class Twist(NamedTuple):
    """How fast a marker moves: `velocity` [m/s] and `angular_velocity` [rad/s]."""

    velocity: Float[Array, "2"]  # [m/s]
    angular_velocity: Float[Array, ""]  # [rad/s]


class Wrench(NamedTuple):
    """What acts on a marker: a `force` [N] and a `torque` [N m]."""

    force: Float[Array, "2"]  # [N]
    torque: Float[Array, ""]  # [N m]


class Marker(eqx.Module):
    """A frame fixed to a material point of a body.

    Made by `body.at(point)` or `ground.at(point)`.

    **Arguments:**

    - `body`: name of the body that carries the marker, or "ground".
    - `point`: the material point X in the body frame [m].
    - `angle`: rotation of the marker against the body [rad].
    """

    body: str = eqx.field(static=True)
    point: Converted[Float[Array, "2"], Vector] = number()
    angle: Converted[Float[Array, ""]] = radians(default=0.0)

    def check(self, owner: str) -> None:
        check_shape(owner, f"marker on '{self.body}': point", self.point, (2,))
        check_shape(owner, f"marker on '{self.body}': angle", self.angle, ())
        check_finite(owner, f"marker on '{self.body}': point", self.point)
        check_finite(owner, f"marker on '{self.body}': angle", self.angle)


class Ground(eqx.Module):
    """The inertial frame; `ground.at(point)` marks a fixed point.

    A `Ground` of one's own has `points` by name: `Ground({"pivot": (0.0, 0.0)}).at("pivot")`.
    """

    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())

    def named_points(self) -> Mapping[str, Float[Array, "2"]]:
        """The points [m] that `at` and `pose` know by name."""
        return self.points.mapping()

    def at(self, point: Vector | str = (0.0, 0.0), angle: Number = 0.0) -> Marker:
        """A marker at a `point` [m] of the inertial frame, or the one of that name, turned by
        `angle` [rad].
        """
        return Marker(GROUND, point_of(GROUND, self.named_points(), point), angle)

    def pose(self, point: Vector | str = (0.0, 0.0)) -> Pose:
        """A fixed position, as in `at`, at an angle of zero."""
        return Pose(self.at(point).point, as_array(0.0))


ground = Ground()


def check_distinct(owner: str, a: Marker, b: Marker) -> None:
    """Raise if a joint would tie a body to itself."""
    if a.body == b.body:
        raise SceneError(
            f"{owner}: both markers are on '{a.body}'; a joint needs two bodies, "
            "or one body and the ground."
        )
