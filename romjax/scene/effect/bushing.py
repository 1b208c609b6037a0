"""An elastic joint."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector
from ..drawing import arc, placed, wheel
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Twist, Wrench
from ..outline import Outline
from .base import AbstractMarkerEffect, check_markers, displacement


class Bushing(AbstractMarkerEffect):
    """A rubber bushing: springs, and dampers if asked for, in the frame of marker `b`.

    With the displacement δ = (x, y, angle) of `a` against `b`, its energy is ½ Σ k δ² and its
    dissipation function ½ Σ d δ'².

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: along x and y of `b` [N/m] and against turning [N m/rad].
    - `damping`: of the same directions [N s/m], [N m s/rad]; none unless given.
    """

    a: Marker
    b: Marker
    stiffness: Converted[Float[Array, "3"], Vector] = number()
    damping: Converted[Float[Array, "3"] | None, Vector] = number(default=None)
    hatched: ClassVar[bool] = True
    stores: ClassVar[bool] = True
    supplies: ClassVar[bool] = False

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.damping is not None

    @property
    def dissipates(self) -> bool:  # type: ignore[override]
        return self.damping is not None

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        return 0.5 * jnp.sum(self.stiffness * _delta(*poses) ** 2)

    def wrenches(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> tuple[Wrench, ...]:
        del t
        delta, rate, wrenches = displacement(_delta, poses, twists)
        force = -self.stiffness * delta
        if self.damping is not None:
            force -= self.damping * rate()
        return wrenches(force)

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """A sleeve that sits on `b`, and a pin inside that sits on `a`."""
        del t
        a, b = poses
        return (
            Outline(wheel(a, 0.45 * size), "spring"),
            Outline(placed(b, arc(size, 2 * np.pi)), "spring"),
        )

    def check(self) -> None:
        owner = check_markers(self)
        check_numbers(owner, self, "stiffness", "damping", shape=(3,), sign="not negative")


def _delta(a: Pose, b: Pose) -> Float[Array, "3"]:
    """Return the displacement of `a` in the frame of `b`: x, y [m], angle [rad]."""
    return jnp.append(b.local(a.position), a.angle - b.angle)
