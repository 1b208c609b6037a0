"""Damping and friction in a joint."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Poses, Twists, Wrench, Wrenches
from ..motion import check_motion, counts, moved
from .along_motion import AbstractMotionEffect
from .base import check_markers, displacement
from .contact import Friction

# The motion of ball joints, in which no direction is the joint's own.
ANY = "any turn"


class JointDamper(AbstractMotionEffect):
    """Damping d s' against a motion s of two markers, and friction, whose force is that of a
    `Friction` with the normal force 1.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `damping`: d [N m s/rad], or [N s/m] of a length.
    - `friction`: a `Friction` with the torque [N m] or the force [N] in place of the coefficient,
      and speeds in [rad/s] or [m/s]; none unless given.
    - `motion`: what s is, as in `JointSpring`; or "any turn" of a ball joint, whose torque is −d
      times the angular velocity of `a` against `b`.

    Raises SceneError for friction of "any turn", which has no one speed.
    """

    a: Marker
    b: Marker
    damping: Converted[Float[Array, ""]] = number(default=0.0)
    friction: Friction | None = None
    motion: str = eqx.field(static=True, default="angle")
    needs_twists: ClassVar[bool] = True
    dissipates: ClassVar[bool] = True
    supplies: ClassVar[bool] = False

    @property
    def counted(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]
        # A speed does not know of full turns.
        return ()

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        if self.motion == ANY:
            torque = self.damping * (twists[1].angular_velocity - twists[0].angular_velocity)
            none = jnp.zeros_like(poses[0].position)
            return Wrench(none, torque), Wrench(none, -torque)
        motion = "bounded angle" if counts(self.motion) else self.motion
        value, rate, wrenches = displacement(lambda *p: moved(motion, *p), poses, twists)
        return wrenches(self.along(t, value, rate))

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        del t, value
        speed = rate()
        force = -self.damping * speed
        return force if self.friction is None else force - self.friction(speed)

    def check(self) -> None:
        owner = check_markers(self)
        if self.motion != ANY:
            check_motion(owner, self.motion, self.a.dimension)
        elif self.friction is not None:
            check_motion(f"{owner} with friction", self.motion, self.a.dimension)
        check_numbers(owner, self, "damping", sign="not negative")
        if self.friction is not None:
            self.friction.check(owner)
