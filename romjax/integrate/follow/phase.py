"""By how much bodies that turn or swing many times may be too far: what errors of energy do."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...linalg import quaternions
from ...linalg.dense import multiply
from ...system.state import Energy

# Turns, to and fro, after which a body counts: before, errors of its speed have not added up.
_TURNS = 3.0
# A swing by less than this angle [rad], from one side to the other, counts by the square of its
# share. The frequency of a pendulum of the amplitude a changes by a²/16 = (2a)²/64 of the share by
# which its energy changes, where a body that whirls is faster by a half. Close to its top it is
# more.
_WHOLE = np.sqrt(32.0)
# So many times |1 - 2 T̄ / max T| it counts at most. With the action J of one freedom,
# 2 T̄ / E = d ln E / d ln J: one, where the frequency dE/dJ is the same at any energy, as of a
# vibration on a linear spring; and of the pendulum 1 - a²/32. A body that whirls counts as a whole.
_BENT = 4.0
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
    those of the balance of energy make a body that turns by ω be off by ω τ, and one that swings by
    as much less as its frequency changes less. Each has a δE and a τ of its own, since a step may
    err in the motion of another one (`shares_of`).

    - `angles`: of the bodies in the plane [rad], one row for each, or their quaternions in space.
      `turned`: how far they have turned [rad], with the `least` and the `most` so far, and the
      `path` (bodies,) to and fro.
    - `spins`: angular velocities [rad/s]; `is_moved` (bodies,): whether anything has changed them.
    - `kinetic`: T [J], with the `largest` so far, and its `integral` [J s]; `time`: since the
      start [s]. `gained` (bodies,): δE [J]; `early` (bodies,): τ [s].
    - `angle`: the largest |ω τ| so far of a body that has turned often [rad]; `swing`: the same of
      one that has turned to and fro.
    """

    angles: Float[Array, "bodies k"]
    turned: Float[Array, "bodies axes"]
    least: Float[Array, "bodies axes"]
    most: Float[Array, "bodies axes"]
    path: Float[Array, " bodies"]
    spins: Float[Array, "bodies axes"]
    is_moved: Bool[Array, " bodies"]
    kinetic: Float[Array, ""]
    largest: Float[Array, ""]
    integral: Float[Array, ""]
    time: Float[Array, ""]
    gained: Float[Array, " bodies"]
    early: Float[Array, " bodies"]
    angle: Float[Array, ""]
    swing: Float[Array, ""]

    @classmethod
    def start(
        cls, angles: Float[Array, "bodies k"], spins: Float[Array, "bodies axes"], kinetic: Array
    ) -> "Phase":
        zero, none = jnp.zeros((), spins.dtype), jnp.zeros(len(spins), spins.dtype)
        turned = (0 * spins,) * 3
        energies = kinetic, kinetic, zero, zero
        nothing = none, none, zero, zero
        return cls(angles, *turned, none, spins, none > 0, *energies, *nothing)

    def follow(
        self,
        h: Float[Array, ""],
        angles: Float[Array, "bodies k"],
        spins: Float[Array, "bodies axes"],
        kinetic: Float[Array, ""],
        gained: Float[Array, " bodies"],
        response: Response,
    ) -> "Phase":
        """Return the phase with a step of the length h added, by what is there at its end, and by
        what energy the motion of each body has `gained` in it, and not by work [J].
        """
        time, integral = self.time + h, self.integral + 0.5 * h * (self.kinetic + kinetic)
        mean = integral / jnp.where(time > 0, time, 1)
        # No less than its mean, since swings that come to rest are no turns. At rest nothing is
        # known.
        usual = jnp.maximum(kinetic, mean)
        share = jnp.where(usual > 0, 0.5 / jnp.where(usual > 0, usual, 1), 0)
        # Forces at the end of the step, as of an implicit method, so that stiff ones are stable.
        pulled = self.gained + gained - response.early * self.early
        energy = pulled / (1 + share * (response.faster + h * response.early))
        early = self.early + h * share * energy
        change = _turn(self.angles, angles)
        turned, path = self.turned + change, self.path + _sizes(change)
        least, most = jnp.minimum(self.least, turned), jnp.maximum(self.most, turned)
        largest = jnp.maximum(self.largest, kinetic)
        bent = _BENT * jnp.abs(1 - 2 * mean / jnp.where(largest > 0, largest, 1))
        reach = _sizes(most - least)
        counts = jnp.minimum(jnp.minimum(reach / _WHOLE, 1) ** 2, bent)
        sizes, whirls = _sizes(spins), 2 * reach > path
        is_moved = self.is_moved | (_sizes(spins - self.spins) > _STEADY * sizes)
        often = (path > 2 * np.pi * _TURNS) & is_moved
        off = jnp.where(often, sizes, 0) * jnp.abs(early)
        angle = jnp.maximum(self.angle, jnp.max(jnp.where(whirls, off, 0)))
        swing = jnp.maximum(self.swing, jnp.max(jnp.where(whirls, 0, counts * off)))
        turns = angles, turned, least, most, path, spins, is_moved
        return Phase(*turns, kinetic, largest, integral, time, energy, early, angle, swing)


def _sizes(x: Float[Array, "bodies axes"]) -> Float[Array, " bodies"]:
    return jnp.sqrt(jnp.sum(x**2, axis=1))


def _turn(
    before: Float[Array, "bodies k"], after: Float[Array, "bodies k"]
) -> Float[Array, "bodies axes"]:
    """How far bodies turn from some angles to others, or from quaternions to others, by less than
    half a turn [rad].
    """
    if before.shape[1] == 1:
        return after - before
    sine, cosine = quaternions.apply(quaternions.space_matrix(before), after), before * after
    cosine, size = jnp.sum(cosine, axis=1), _sizes(sine)
    turn = 2 * jnp.arctan2(size, jnp.abs(cosine)) * jnp.sign(cosine)
    return sine * (turn / jnp.where(size > 0, size, 1))[:, None]


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
