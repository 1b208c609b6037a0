"""The base of lifts: physical coordinates as a function of few others."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...system.base import AbstractSystem
from ...system.reduced import Physical as Physical
from ...system.reduced import Reduced as Reduced


class Motion(NamedTuple):
    """A reduced state as the full system sees it: v = G w + ∂L/∂t and q̈ = G ẇ + β."""

    q: Float[Array, " n"]
    v: Float[Array, " n"]
    tangent: Float[Array, "n r"]  # G = ∂L/∂z
    bias: Float[Array, " n"] | None  # β; None where it is zero for every motion


class AbstractLift(eqx.Module):
    """q = L(t, z): the configurations that a reduced system can take.

    `full` is the system that is reduced; lifts that follow from its constraints ask it for them.
    """

    @abc.abstractmethod
    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        """L(t, z)."""

    @abc.abstractmethod
    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        """The physical motion where z changes with the velocity w."""

    @abc.abstractmethod
    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        """The z and w of physical coordinates and velocities, or of the nearest on the lift."""

    @abc.abstractmethod
    def with_full(self, full: AbstractSystem) -> "AbstractLift":
        """The same lift for a system with other numbers."""


def differentiate(
    position: Callable[..., Physical],
    t: Time,
    z: Reduced,
    w: Reduced,
    tangent: Float[Array, "n r"] | None = None,
) -> Motion:
    """The motion of an explicit lift `position(t, z)`, by autodiff, unless `tangent` is known.

    Along the motion d/dt L = G w + L_t, and once more with ẇ = 0: β = (G w)_z w + 2 G_t w + L_tt.
    """
    t = jnp.asarray(t, z.dtype)
    one = jnp.ones_like(t)

    def rate(t: Array, z: Array) -> tuple[Array, Array]:
        q, v = jax.jvp(position, (t, z), (one, w))
        return q, v

    (q, v), (_, bias) = jax.jvp(rate, (t, z), (one, w))
    if tangent is None:
        tangent = jax.jacfwd(position, argnums=1)(t, z)
    return Motion(q, v, tangent, bias)
