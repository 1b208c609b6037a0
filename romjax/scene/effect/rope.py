"""A rope over pulleys."""

import itertools
from collections.abc import Iterable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...common.arrays import Time
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists, Wrenches
from ..motion import moved
from ..outline import Outline, Outlines
from .base import AbstractMarkerEffect, check_markers, displacement


class Rope(AbstractMarkerEffect):
    """A rope between two points over small pulleys without friction: it pulls where it is taut, and
    does nothing where it is slack.

    The straight pieces from point to point are L long together. Where they are longer than the rope
    by s = L − length, its tension is k s (1 + D s'), never negative, the same in all pieces: it
    begins at zero at any speed, as in `Contact`. The rope has no mass, does not bend, and pulleys
    are points: a wheel that is large against the pieces, or that has an inertia, is a body with a
    `Coupling`.

    **Arguments:**

    - `a`, `b`: the two ends. `via`: markers that it runs over, in their order from `a` to `b`; none
      unless given. Several may be on one body, as in a tackle. In `effect_forces` they are the
      sides "c", "d", ….
    - `length`: of the slack rope [m]. `stiffness`: k [N/m], as E A / length.
    - `dissipation`: D [s/m]; none unless given.
    - `name`: of the rope.

    Raises SceneError for a length that is not positive, and negative numbers.
    """

    a: Marker
    b: Marker
    length: Converted[Float[Array, ""]] = number()
    stiffness: Converted[Float[Array, ""]] = number()
    via: Converted[tuple[Marker, ...], Iterable[Marker]] = eqx.field(converter=tuple, default=())
    dissipation: Converted[Float[Array, ""] | None] = number(default=None)
    name: str = eqx.field(static=True, default="")
    side: Float[Array, ""] | None = eqx.field(default_factory=lambda: None, init=False, repr=False)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    hatched: ClassVar[bool] = True
    stores: ClassVar[bool] = True
    supplies: ClassVar[bool] = False
    begins: ClassVar[bool] = True
    goes_on: ClassVar[bool] = True

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (self.a, self.b, *self.via)

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return tuple(range(len(self.via) + 2))

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None

    @property
    def dissipates(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        return 0.5 * self.stiffness * self._stretch(_length(*poses)) ** 2

    def room(self, *poses: Pose) -> Float[Array, ""]:
        return self.length - _length(*poses)

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del t
        length, rate, wrenches = displacement(_length, poses, twists)
        tension = self.stiffness * self._stretch(length)
        if self.dissipation is not None:
            # Never a push: a rope that shortens faster than the damping allows is slack.
            tension *= jnp.maximum(1 + self.dissipation * rate(), 0)
        return wrenches(-tension)

    def acting(self, acts: Bool[Array, ""]) -> "Rope":
        """Return the rope as a spring without loss, if it is to act, else as it is."""
        stiffness = self.stiffness
        loss = jnp.zeros_like(stiffness) if self.dissipation is None else self.dissipation
        other: Rope = eqx.tree_at(
            lambda rope: rope.dissipation,
            self,
            jnp.where(acts, 0.0, loss),
            is_leaf=lambda x: x is None,
        )
        return other.held(jnp.where(acts, -1.0, 0.0) + 0 * stiffness)

    def held(self, side: Float[Array, ""]) -> "Rope":
        """Return the rope as a spring on both sides of its length, or as none."""
        held: Rope = eqx.tree_at(lambda x: x.side, self, side, is_leaf=lambda x: x is None)
        return held

    def _stretch(self, length: Float[Array, ""]) -> Float[Array, ""]:
        """How much longer the rope is than when it is slack [m]."""
        stretch = length - self.length
        if self.side is None:
            return jnp.maximum(stretch, 0)
        return jnp.where(jnp.where(self.side == 0, stretch > 0, self.side < 0), stretch, 0)

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t, size
        return (Outline(jnp.stack([pose.position for pose in _along(poses)]), "link"),)

    def check(self) -> None:
        owner = check_markers(self)
        check_numbers(owner, self, "length", sign="positive")
        check_numbers(owner, self, "stiffness", "dissipation", sign="not negative")


def _along(poses: Poses) -> Poses:
    """The poses from one end to the other."""
    a, b, *via = poses
    return (a, *via, b)


def _length(*poses: Pose) -> Float[Array, ""]:
    """The length of the straight pieces from point to point [m]."""
    # Pulleys are points: the rope does not wind around them.
    pieces = [moved("distance", *pair) for pair in itertools.pairwise(_along(poses))]
    return jnp.sum(jnp.stack(pieces))
