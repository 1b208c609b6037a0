"""Quantities: numbers that follow from the state of a mechanism, as functions of it.

A quantity is called with (system, t, q, v), where q and v are coordinates of that system, full or
reduced, and returns one number; it is smooth wherever the mechanism is, so that its zero can be an
event.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..assembly.locate import locate
from ..common.arrays import Time
from ..common.checks import unknown_name
from ..common.errors import InputError
from ..linalg.dense import length
from ..scene.coordinate import find
from ..scene.marker import Marker, Pose
from ..system.base import AbstractSystem
from .kinematics import relative

__all__ = ["AbstractQuantity", "Coordinate", "Gap", "Rate", "Travel", "Turn"]


class AbstractQuantity(eqx.Module):
    """One number of the state of a mechanism; subclass it with `value`."""

    @property
    def jumps(self) -> bool:
        """Whether the value jumps where the mechanism does not, so that events cannot watch it."""
        return False

    def __call__(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, ""]:
        """Return the value at the state `q`, `v` of a full or reduced `system`, at `t` [s]."""
        state = system.state(t, q, v)
        return self.value(system.full, t, state.q, state.v)

    @abc.abstractmethod
    def value(
        self, full: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, ""]:
        """Return the value at the physical state (`t`, `q`, `v`) of a full system."""


class Coordinate(AbstractQuantity):
    """A physical coordinate by its `label`, such as "cart.x"; with a prime, "cart.x'", its rate; or
    a state of an effect, such as "pid.integral".
    """

    label: str = eqx.field(static=True)

    def value(
        self, full: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, ""]:
        column = find(self.label, full.structure.labels)
        if column is None:
            raise unknown_name("quantity", "coordinate", self.label, full.structure.labels)
        number, is_rate = column
        return (v if is_rate else q)[number]


class AbstractMarkerQuantity(AbstractQuantity):
    """A function of the pose of the marker `a` in the frame of the marker `b`."""

    a: eqx.AbstractVar[Marker]
    b: eqx.AbstractVar[Marker]

    def value(
        self, full: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, ""]:
        located = locate(f"quantity {type(self).__name__}", full, [self.a, self.b])
        return self.of_pose(relative(located.markers, located.own(q)))

    @abc.abstractmethod
    def of_pose(self, pose: Pose) -> Float[Array, ""]:
        """Return the value from the `pose` of a in the frame of b."""


class Gap(AbstractMarkerQuantity):
    """The distance of the markers `a` and `b`, less `clearance` [m]."""

    a: Marker
    b: Marker
    clearance: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)

    def of_pose(self, pose: Pose) -> Float[Array, ""]:
        return length(pose.position) - self.clearance


class Travel(AbstractMarkerQuantity):
    """How far the marker `a` is along the x axis of the marker `b` [m].

    In space too, where joints slide along z: for the travel of a slider take markers whose x axis
    is that of the joint.
    """

    a: Marker
    b: Marker

    def of_pose(self, pose: Pose) -> Float[Array, ""]:
        return pose.position[0]


class Turn(AbstractMarkerQuantity):
    """The angle of the marker `a` against the marker `b` [rad], full turns counted.

    In space it is that about the z axis of `b`, between −π and π: no pose knows how often it has
    turned. There it jumps at a half turn, but its rate does not.
    """

    a: Marker
    b: Marker

    @property
    def jumps(self) -> bool:
        return self.b.dimension == 3

    def of_pose(self, pose: Pose) -> Float[Array, ""]:
        if pose.dimension == 2:
            return pose.angle
        own = Pose(jnp.zeros_like(pose.position), jnp.array([1, 0, 0, 0], pose.turn.dtype))
        # Turned back by its own value it has its derivatives at a half turn too.
        near = jax.lax.stop_gradient(pose.angle_against(own))
        return near + pose.angle_against(own, near)


class Rate(AbstractQuantity):
    """The rate of the quantity `of`, per second."""

    of: AbstractQuantity

    def __check_init__(self) -> None:
        if isinstance(self.of, Rate) or getattr(self.of, "label", "").endswith("'"):
            raise InputError(
                f"Rate: {self.of!r} is a rate itself, and accelerations are no part of a state."
            )

    def value(
        self, full: AbstractSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, ""]:
        t = jnp.asarray(t, q.dtype)
        rate: Array
        _, rate = jax.jvp(lambda t, q: self.of.value(full, t, q, v), (t, q), (jnp.ones_like(t), v))
        return rate
