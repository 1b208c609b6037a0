"""The inertia of what turns or slides with a joint, such as the rotor of its motor."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists, Wrench, Wrenches
from ..motion import check_motion, is_limited, limit_of
from .base import AbstractMarkerEffect, check_markers


class JointInertia(AbstractMarkerEffect):
    """The inertia J that a motion s of two markers feels, with the kinetic energy ½ J s'²: of a
    rotor with the inertia I behind a gear of ratio n it is n² I ("armature").

    The system has a coordinate more, which is s, and a constraint that holds it there; in
    `JointCoordinates` s is that of the joint, and nothing is more.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `inertia`: J [kg m²], or [kg] of a length.
    - `motion`: what s is, as in `JointSpring`.
    """

    a: Marker
    b: Marker
    inertia: Converted[Float[Array, ""]] = number()
    motion: str = eqx.field(static=True, default="angle")
    needs_twists: ClassVar[bool] = False
    acts: ClassVar[bool] = False
    supplies: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (3,)
    counted: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)

    @property
    def limited(self) -> bool:  # type: ignore[override]
        return is_limited(self.motion)

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """Return where three angles are told apart no more: a number that changes its sign."""
        return limit_of(self.motion, *poses)

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del t, twists
        none = jnp.zeros_like(poses[0].position)
        return tuple(Wrench(none, none) for _ in poses)

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        check_numbers(owner, self, "inertia", sign="positive")
