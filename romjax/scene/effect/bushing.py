"""An elastic joint."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..fields import Time, check_finite, check_not_negative, check_shape, number
from ..marker import Marker, Pose, Twist, Wrench
from .base import AbstractMarkerEffect, check_markers


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
    stiffness: Float[Array, "3"] = number()
    damping: Float[Array, "3"] | None = number(None)

    def __check_init__(self) -> None:
        self.check()

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.damping is not None

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (self.a, self.b)

    def wrenches(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> tuple[Wrench, ...]:
        del t
        force = -self.stiffness * _displacement(poses)
        if self.damping is not None:
            rates = tuple(Pose(*twist) for twist in twists)
            force -= self.damping * jax.jvp(_displacement, (poses,), (rates,))[1]
        # Virtual work: force · δ-variation, shared among both markers.
        _, pull_back = jax.vjp(_displacement, poses)
        return tuple(Wrench(*pose) for pose in pull_back(force)[0])

    def check(self) -> None:
        owner = check_markers(self)
        for field in ("stiffness", "damping"):
            value = getattr(self, field)
            if value is not None:
                check_shape(owner, field, value, (3,))
                check_finite(owner, field, value)
                check_not_negative(owner, field, value)


def _displacement(poses: tuple[Pose, ...]) -> Float[Array, "3"]:
    """Of `a` in the frame of `b`: x, y [m], angle [rad]."""
    a, b = poses
    return jnp.append(b.local(a.position), a.angle - b.angle)
