"""By how much bodies that turn many times may have gone too far: what errors of energy do."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...linalg import quaternions
from ...system.base import AbstractSystem

# Turns after which a body counts: before, errors of its speed have not added up.
_TURNS = 3.0
# Changes of an angular velocity below this share are rounding: such a body, as a balanced wheel in
# the plane, turns without any effort, and no step errs in it.
_STEADY = 1e-7


class Response(NamedTuple):
    """How forces act against a motion that is early: what they give less in a step [J] for each [1]
    that it is faster, and for each second that it is early [W]; not negative.
    """

    faster: Float[Array, ""]
    early: Float[Array, ""]


class Phase(NamedTuple):
    """By how much a motion is early, since its energy E errs by δE.

    Let q̃(t) = q(t + τ). Its speed is v (1 + τ̇), its energy errs by δE = 2 T τ̇, and forces Q change
    that by (δE)˙ = τ̇ vᵀ(∂Q/∂v) v − τ ∂P/∂t, with the power P of loads. So steps whose errors are
    those of the balance of energy make a body that turns by ω be off by ω τ.

    - `spins`: angular velocities [rad/s], one row for each body; `turned`: their integrals [rad];
      `is_moved` (bodies,): whether anything has changed them.
    - `gained`: δE [J]; `kinetic`: ∫ T dt [J s]; `time`: since the start [s]; `early`: τ [s].
    - `angle`: the largest |ω τ| so far of a body that has turned often [rad].
    """

    spins: Float[Array, "bodies axes"]
    turned: Float[Array, "bodies axes"]
    is_moved: Bool[Array, " bodies"]
    gained: Float[Array, ""]
    kinetic: Float[Array, ""]
    time: Float[Array, ""]
    early: Float[Array, ""]
    angle: Float[Array, ""]

    @classmethod
    def start(cls, spins: Float[Array, "bodies axes"]) -> "Phase":
        zero = jnp.zeros((), spins.dtype)
        return cls(spins, 0 * spins, jnp.zeros(len(spins), bool), *[zero] * 5)

    def follow(
        self,
        h: Float[Array, ""],
        spins: Float[Array, "bodies axes"],
        kinetic: Float[Array, ""],
        gained: Float[Array, ""],
        response: Response,
    ) -> "Phase":
        """Return the phase with a step of the length h added, by what is there at its end, and by
        what energy was `gained` in it, and not by work [J].
        """
        turned, time = self.turned + 0.5 * h * (self.spins + spins), self.time + h
        mean = self.kinetic + h * kinetic
        # No less than its mean, since swings that come to rest are no turns. At rest nothing is
        # known.
        least = jnp.maximum(kinetic, mean / jnp.where(time > 0, time, 1))
        share = jnp.where(least > 0, 0.5 / jnp.where(least > 0, least, 1), 0)
        # Forces at the end of the step, as of an implicit method, so that stiff ones are stable.
        pulled = self.gained + gained - response.early * self.early
        energy = pulled / (1 + share * (response.faster + h * response.early))
        early = self.early + h * share * energy
        sizes, changes = (jnp.sum(x**2, axis=1) for x in (spins, spins - self.spins))
        is_moved = self.is_moved | (changes > _STEADY**2 * sizes)
        often = jnp.sum(turned**2, axis=1) > (2 * np.pi * _TURNS) ** 2
        angles = jnp.where(often & is_moved, jnp.sqrt(sizes), 0) * jnp.abs(early)
        angle = jnp.maximum(self.angle, jnp.max(angles))
        return Phase(spins, turned, is_moved, energy, mean, time, early, angle)


def spins_of(
    full: AbstractSystem, q: Float[Array, " N"], v: Float[Array, " N"]
) -> Float[Array, "bodies axes"]:
    """The angular velocity of each body of a full system [rad/s], in space by its axes."""
    structure: Any = full.structure
    q, v = q[structure.turns], v[structure.turns]
    return quaternions.angular_velocity(q, v) if structure.quaternions else v
