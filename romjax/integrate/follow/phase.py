"""By how much bodies that turn many times may have gone too far: what errors of energy do."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...linalg import quaternions
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ...system.state import Energy

# Turns after which a body counts: before, errors of its speed have not added up.
_TURNS = 3.0
# Changes of an angular velocity below this share are rounding: such a body, as a balanced wheel in
# the plane, turns without any effort, and no step errs in it.
_STEADY = 1e-7
# Estimates of the errors of a step scatter, coordinate by coordinate, so that a body has less than
# all of an error of energy only where its own is so many times too small for that.
_SCATTER = 10.0


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
    those of the balance of energy make a body that turns by ω be off by ω τ. Each has a δE and a τ
    of its own, since a step may err in the motion of another one (`shares_of`).

    - `spins`: angular velocities [rad/s], one row for each body; `turned`: their integrals [rad];
      `is_moved` (bodies,): whether anything has changed them.
    - `gained` (bodies,): δE [J]; `kinetic`: ∫ T dt [J s]; `time`: since the start [s]; `early`
      (bodies,): τ [s].
    - `angle`: the largest |ω τ| so far of a body that has turned often [rad].
    """

    spins: Float[Array, "bodies axes"]
    turned: Float[Array, "bodies axes"]
    is_moved: Bool[Array, " bodies"]
    gained: Float[Array, " bodies"]
    kinetic: Float[Array, ""]
    time: Float[Array, ""]
    early: Float[Array, " bodies"]
    angle: Float[Array, ""]

    @classmethod
    def start(cls, spins: Float[Array, "bodies axes"]) -> "Phase":
        zero, none = jnp.zeros((), spins.dtype), jnp.zeros(len(spins), spins.dtype)
        return cls(spins, 0 * spins, jnp.zeros(len(spins), bool), none, zero, zero, none, zero)

    def follow(
        self,
        h: Float[Array, ""],
        spins: Float[Array, "bodies axes"],
        kinetic: Float[Array, ""],
        gained: Float[Array, " bodies"],
        response: Response,
    ) -> "Phase":
        """Return the phase with a step of the length h added, by what is there at its end, and by
        what energy the motion of each body has `gained` in it, and not by work [J].
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


def shares_of(
    energy: Energy,
    v: Float[Array, " n"],
    errors: tuple[Float[Array, " n"], Float[Array, " n"]],
    spins: Float[Array, "bodies axes"],
    spin_errors: tuple[Float[Array, "bodies axes"], Float[Array, "bodies axes"]],
) -> Float[Array, " bodies"]:
    """What share of a step's error of energy is one of each body's speed, as its method estimates
    it: all, where the motion has one freedom; of a motor's wheel little, where it is the carriage
    that vibrates.

    An error e of the motion changes the energy by ε = e_vᵀ ∂T/∂v + e_qᵀ ∂V/∂q, and if it is along
    the motion, the speed of each body by the share ε / 2T of it.

    **Arguments:**

    - `energy`, `v`: at the end of the step, of the system. `errors`: e_q, e_v of the step.
    - `spins`: the angular velocities of bodies, and `spin_errors` by e_q and e_v.
    """
    # The derivative of the size of nothing is infinite.
    parts = jax.lax.stop_gradient((energy, v, errors, spins, spin_errors))
    energy, v, (of_q, of_v), spins, (turned, faster) = parts
    change = multiply(energy.slope, of_q) + multiply(energy.momentum, of_v)
    own = jnp.linalg.norm(faster, axis=1) * 2 * energy.kinetic
    own += jnp.linalg.norm(turned, axis=1) * jnp.abs(multiply(energy.slope, v))
    own *= _SCATTER
    whole = jnp.linalg.norm(spins, axis=1) * jnp.abs(change)
    return jnp.where(own < whole, own / jnp.where(whole > 0, whole, 1), 1.0)


def spins_of(
    full: AbstractSystem, q: Float[Array, " N"], v: Float[Array, " N"]
) -> Float[Array, "bodies axes"]:
    """The angular velocity of each body of a full system [rad/s], in space by its axes."""
    structure: Any = full.structure
    q, v = q[structure.turns], v[structure.turns]
    return quaternions.angular_velocity(q, v) if structure.quaternions else v
