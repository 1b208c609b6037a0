"""The base of effects in joints, which act along a motion of one marker against another."""

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..marker import Pose, Poses, Twists
from ..motion import counts, is_limited, limit_of, moved, points_of
from .base import AbstractMarkerEffect, Displacement, displacement


class AbstractMotionEffect(AbstractMarkerEffect):
    """An effect along a `motion` of its first marker against its second, as in `JointSpring`."""

    if TYPE_CHECKING:
        # To checkers a field of this class would come before those of the kinds.
        @property
        def motion(self) -> str: ...
    else:
        motion: eqx.AbstractVar[str]
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def counted(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]
        return counts(self.motion)

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return points_of(self.motion)

    @property
    def limited(self) -> bool:  # type: ignore[override]
        return is_limited(self.motion)

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """Return where three angles are told apart no more: a number that changes its sign."""
        return limit_of(self.motion, *poses)

    def displacement(self, poses: Poses, twists: Twists) -> Displacement:
        """The motion, and the functions of its rate and of the wrenches of a force along it."""
        return displacement(lambda *p: moved(self.motion, *p), poses, twists)

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        """The force [N] or torque [N m] along the motion, by its value and its rate, for kinds that
        depend on nothing else: where the motion is the coordinate of a joint it is the force on
        that, without poses and wrenches.
        """
        raise NotImplementedError
