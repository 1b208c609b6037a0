"""The stops of a joint."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...common.arrays import Time, concrete
from ...common.errors import SceneError
from ..fields import Converted, check_numbers, number
from ..limits import check_limits
from ..marker import Marker, Pose, Poses, Twists, Wrenches
from ..motion import TURN, check_motion, moved
from .along_motion import AbstractMotionEffect
from .base import check_markers


class JointStop(AbstractMotionEffect):
    """Stops that keep a motion s of two markers between two values, by a force that grows with
    what s is beyond them.

    At the depth δ the force is k δ (1 + D δ'), never negative, as in `Contact`: it begins at zero
    at any speed. With D, slow impacts at the speed v have a restitution of 1 − 2 D v / 3.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `lower`, `upper`: the least and the largest s [rad], [m]; none unless given. An angle of the
      whole rotation has an upper one alone, between 0 and π.
    - `stiffness`: k [N m/rad], or [N/m] of a length.
    - `dissipation`: D [s/rad], [s/m]; none unless given.
    - `motion`: what s is, as in `JointSpring`; or "turn" of a ball joint, the angle of the whole
      rotation in space, from 0 to π.

    Raises SceneError if `lower` is not below `upper`, if neither is given, or if the angle of the
    whole rotation has a `lower` one or cannot reach the `upper` one.
    """

    a: Marker
    b: Marker
    lower: Converted[Float[Array, ""] | None] = number(default=None)
    upper: Converted[Float[Array, ""] | None] = number(default=None)
    stiffness: Converted[Float[Array, ""]] = number(default=1e4)
    dissipation: Converted[Float[Array, ""] | None] = number(default=None)
    motion: str = eqx.field(static=True, default="angle")
    side: Float[Array, ""] | None = eqx.field(default_factory=lambda: None, init=False, repr=False)
    stores: ClassVar[bool] = True
    supplies: ClassVar[bool] = False
    begins: ClassVar[bool] = True
    goes_on: ClassVar[bool] = True

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None

    @property
    def oscillates(self) -> bool:  # type: ignore[override]
        return self.motion != "angle"

    @property
    def dissipates(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        beyond, _ = self._beyond(moved(self.motion, *poses))
        return 0.5 * self.stiffness * beyond**2

    def room(self, *poses: Pose) -> Float[Array, ""]:
        value = moved(self.motion, *poses)
        sides = [] if self.upper is None else [self.upper - value]
        sides += [] if self.lower is None else [value - self.lower]
        return jnp.minimum(sides[0], sides[-1])

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        value, rate, wrenches = self.displacement(poses, twists)
        return wrenches(self.along(t, value, rate))

    def along(
        self, t: Time, value: Float[Array, ""], rate: Callable[[], Float[Array, ""]]
    ) -> Float[Array, ""]:
        del t
        beyond, sign = self._beyond(value)
        push = -self.stiffness * beyond
        if self.dissipation is not None:
            push *= jnp.maximum(1 + self.dissipation * sign * rate(), 0)
        return push

    def acting(self, acts: Bool[Array, ""]) -> "JointStop":
        """Return the stops as a spring about zero, if they are to act, else as they are."""
        given = self.lower, self.upper, self.dissipation
        numbers = zip(given, (-jnp.inf, jnp.inf, 0.0), strict=True)
        values = [absent if x is None else x for x, absent in numbers]
        other: JointStop = eqx.tree_at(
            lambda stop: (stop.lower, stop.upper, stop.dissipation),
            self,
            tuple(jnp.where(acts, 0.0, x) + 0 * self.stiffness for x in values),
            is_leaf=lambda x: x is None,
        )
        return other

    def held(self, side: Float[Array, ""]) -> "JointStop":
        """Return the stops with the spring of the nearer one on both sides of it, or on none."""
        held: JointStop = eqx.tree_at(lambda x: x.side, self, side, is_leaf=lambda x: x is None)
        return held

    def _beyond(self, value: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """How far a motion is beyond its stops, negative below the lower one, and the sign of
        motions beyond the stop that acts.
        """
        if self.side is None:
            beyond = jnp.zeros_like(value)
            if self.upper is not None:
                beyond += jnp.maximum(value - self.upper, 0)
            if self.lower is not None:
                beyond += jnp.minimum(value - self.lower, 0)
            return beyond, jnp.sign(beyond)
        over = jnp.full_like(value, -jnp.inf) if self.upper is None else value - self.upper
        under = jnp.full_like(value, -jnp.inf) if self.lower is None else self.lower - value
        deep = jnp.maximum(over, under)
        acts = jnp.where(self.side == 0, deep > 0, self.side < 0)
        sign = jnp.where(acts, jnp.where(over > under, 1.0, -1.0), 0.0)
        return jnp.where(acts, sign * deep, 0.0), sign

    def check(self) -> None:
        owner = check_markers(self)
        if self.motion != TURN or self.a.dimension == 2:
            check_motion(owner, self.motion, self.a.dimension)
        check_numbers(owner, self, "stiffness", "dissipation", sign="not negative")
        check_limits(owner, self, "lower", "upper", apart=True)
        if self.lower is None and self.upper is None:
            raise SceneError(f"{owner}: it has no stop; give lower, upper or both.")
        if self.motion == TURN:
            self._check_turn(owner)

    def _check_turn(self, owner: str) -> None:
        """Check the stops of an angle from 0 to π, whose slope jumps at both."""
        if self.lower is not None:
            lower = concrete(self.lower)
            value = "" if lower is None else f" is {lower:g}, but it"
            raise SceneError(
                f"{owner}: lower{value} has no meaning for the angle of a whole rotation, which "
                "has no direction at zero; leave it out, or give a stop about each axis.",
                field="lower",
            )
        upper = concrete(self.upper)
        # π of single precision, which is a little more.
        if upper is not None and not np.all((upper >= 0) & (upper <= np.float32(np.pi))):
            raise SceneError(
                f"{owner}: upper is {upper:g}, but the angle of a whole rotation goes from 0 to π "
                "[rad]; give a value between, or no stop.",
                field="upper",
            )
