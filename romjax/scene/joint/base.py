"""The base of joints: one residual of the poses of their markers."""

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...common.fields import AbstractClassVar
from ...linalg import quaternions
from ..marker import Marker, Pose, Poses
from ..marker_checks import check_connected, check_distinct, check_markers
from ..outline import Outlines, linked

# The coordinates of joints that turn in any direction.
QUATERNION = (("w", ""), ("x", ""), ("y", ""), ("z", ""))


class AbstractJoint(eqx.Module):
    """A constraint between two markers, or more: holonomic, but for an `AbstractSlipJoint`.

    A joint of one's own is a subclass with the fields `a`, `b`, `name`, the number of `rows`
    and the `residual`. Its Jacobian, its time derivatives and the multipliers follow by autodiff.
    With further markers, `markers` names all in the order of the fields, and `residual` takes them
    after `a` and `b`; then come the poses of counters, see `counted_angle`.
    """

    a: eqx.AbstractVar[Marker]
    b: eqx.AbstractVar[Marker]
    if TYPE_CHECKING:
        # As a field of this class it would come before those of the joints to type checkers.
        name = ""
    else:
        name: eqx.AbstractVar[str]
    rows: AbstractClassVar[int]

    # In the plane (2), in space (3), or in both.
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    # Pairs of its markers, by their numbers, in space whose angle counts full turns.
    counted: ClassVar[tuple[tuple[int, int], ...]] = ()
    # The numbers of its markers whose positions are all that it asks for: it never asks how these
    # are turned, nor turns them.
    at_points: ClassVar[tuple[int, ...]] = ()
    # Whether pictures hatch the ground at a marker on it.
    hatched: ClassVar[bool] = True
    # The names and units of the joint's own coordinates, of which `place` makes a pose; None where
    # it has none, so that joint coordinates keep its residual instead.
    freedoms: ClassVar[tuple[tuple[str, str], ...] | None] = None
    # The motions of `a` against `b` that these are, by the names that effects in joints know.
    motions: ClassVar[tuple[str, ...]] = ()
    # Whether the last four of them are a quaternion, of any length.
    turns_freely: ClassVar[bool] = False
    # The numbers of its rows that hold velocities, not positions, see `AbstractSlipJoint`.
    slips: ClassVar[tuple[int, ...]] = ()

    def __check_init__(self) -> None:
        check_connected(self)
        self.check()

    @abc.abstractmethod
    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, " rows"]:
        """Return the residual, zero where the joint holds: lengths [m] and angles [rad]."""

    def place(self, z: Float[Array, " freedoms"]) -> Pose:
        """The pose of `a` in the frame of `b` at the joint's own coordinates."""
        raise NotImplementedError

    def read(self, a: Pose, b: Pose) -> Float[Array, " freedoms"]:
        """The joint's own coordinates from the poses of its markers, the inverse of `place`."""
        raise NotImplementedError

    def screws(self, z: Float[Array, " freedoms"]) -> Float[Array, "rates twist"]:
        """The twists of `a` against `b` for unit rates of the joint's own coordinates, of a free
        turn for unit angular velocities: angular velocity [rad/s], then velocity [m/s] of the point
        of `a` at the origin of `b`, all by the axes of `b`.

        A joint without this has them by autodiff of `place`; where it is there, the quaternions of
        `place` have unit length, unless the joint turns freely.
        """
        raise NotImplementedError

    @property
    def takes_start(self) -> bool:
        """Whether something was left out that `starting_at` takes from the start."""
        return False

    def starting_at(self, *poses: Pose) -> "AbstractJoint":
        """The joint with what was left out, from the poses of its markers at the start."""
        del poses
        return self

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Return the outlines for pictures, from the poses of `a` and `b` at time t.

        `size` [m] is what a sign such as the box of a slider should be about as large as. Without a
        method of its own a joint is a line between its markers.
        """
        del t, size
        return linked(poses)

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (self.a, self.b)

    def label(self) -> str:
        """The label of the joint in messages: its name, or its kind and its bodies."""
        return self.name or f"{type(self).__name__}({self.a.body}, {self.b.body})"

    def owner(self) -> str:
        """The beginning of messages about the joint."""
        return f"joint '{self.label()}'"

    def check_among(self, joints: Sequence["AbstractJoint"]) -> None:
        """Raise a SceneError if the joint contradicts others of the scene."""

    def check(self) -> None:
        """Raise a SceneError that names joint, field, value and remedy."""
        owner = self.owner()
        check_markers(owner, self.markers, self.dimensions)
        check_distinct(owner, self.a, self.b)


def turns_at(place: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """The twists about the origin of unit angular velocities of a body about a `place`."""
    across = jnp.swapaxes(quaternions.skew(place), 0, 1)
    return jnp.concatenate([np.eye(3, dtype=place.dtype), across], axis=1)
