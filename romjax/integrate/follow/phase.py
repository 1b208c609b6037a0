"""By how much bodies that turn, swing or go round many times may be too far: what errors of energy
do.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...linalg import quaternions
from ...linalg.dense import length, multiply
from ...linalg.plane import perpendicular
from ...system.state import Energy
from .bounces import Bounces, Touching

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
# A direction that changes by more in a step [rad] is that of a body that turns back.
_BACK = 2.0
# Estimates of the errors of a step scatter, coordinate by coordinate, so that a body has less than
# all of an error of energy only where its own is so many times too small for that.
_SCATTER = 10.0


class Response(NamedTuple):
    """How forces act against a motion that is early: what they give less in a step [J] for each [1]
    that it is faster, and for each second that it is early [W]; not negative.
    """

    faster: Float[Array, ""]
    early: Float[Array, ""]


class Motion(NamedTuple):
    """How bodies turn and go round at a time.

    - `angles`: of the bodies in the plane [rad], one row for each, or their quaternions in space;
      `spins`: their angular velocities [rad/s].
    - `velocities`: of their frames [m/s].
    """

    angles: Float[Array, "bodies k"]
    spins: Float[Array, "bodies axes"]
    velocities: Float[Array, "bodies d"]


class Turned(NamedTuple):
    """How far something has turned so far: `angle` [rad], with its `least` and `most`, and the
    `path` (bodies,) to and fro.
    """

    angle: Float[Array, "bodies axes"]
    least: Float[Array, "bodies axes"]
    most: Float[Array, "bodies axes"]
    path: Float[Array, " bodies"]

    def add(self, change: Float[Array, "bodies axes"]) -> "Turned":
        """Turned by a `change` more."""
        angle = self.angle + change
        least, most = jnp.minimum(self.least, angle), jnp.maximum(self.most, angle)
        return Turned(angle, least, most, self.path + length(change))

    @property
    def reach(self) -> Float[Array, " bodies"]:
        return length(self.most - self.least)

    @property
    def whirls(self) -> Bool[Array, " bodies"]:
        """Whether it turns on, and not to and fro."""
        return 2 * self.reach > self.path

    @property
    def often(self) -> Bool[Array, " bodies"]:
        return self.path > 2 * np.pi * _TURNS


class Phase(NamedTuple):
    """By how much a motion is early, since its energy E errs by δE.

    Let q̃(t) = q(t + τ). Its speed is v (1 + τ̇), its energy errs by δE = 2 T τ̇, and forces Q change
    that by (δE)˙ = τ̇ vᵀ(∂Q/∂v) v − τ ∂P/∂t, with the power P of loads. So steps whose errors are
    those of the balance of energy make a body that turns by ω be off by ω τ, and one that swings by
    as much less as its frequency changes less. Each has a δE and a τ of its own, since a step may
    err in the motion of another one (`shares_of`). A body that goes round without turning is off by
    the share ω τ of its distance, with the mean angular velocity ω of the direction in which it
    moves. Those that bounce are judged by `Bounces`.

    - `motion`: at the end of the last step. `turns`: of bodies; `is_moved` (bodies,): whether
      anything has changed their angular velocities. `rounds`: of the directions of velocities.
      `bounces`: None where nothing may begin.
    - `kinetic`: T [J], with the `largest` so far, and its `integral` [J s]; `time`: since the
      start [s]. `gained`: δE [J], first of turns and then of rounds; `early`: τ [s] of them.
    - `angle`: the largest |ω τ| so far of a body that has turned often [rad]; `swing`: the same of
      one that has turned to and fro, or gone round.
    """

    motion: Motion
    turns: Turned
    is_moved: Bool[Array, " bodies"]
    rounds: Turned
    bounces: Bounces | None
    kinetic: Float[Array, ""]
    largest: Float[Array, ""]
    integral: Float[Array, ""]
    time: Float[Array, ""]
    gained: Float[Array, "2 bodies"]
    early: Float[Array, "2 bodies"]
    angle: Float[Array, ""]
    swing: Float[Array, ""]

    @classmethod
    def start(cls, motion: Motion, touching: Touching | None, kinetic: Array) -> "Phase":
        zero, none = jnp.zeros((), kinetic.dtype), jnp.zeros(len(motion.spins), kinetic.dtype)
        level, nothing = 0 * motion.spins, jnp.stack([none, none])
        # In the plane directions turn about one axis, as bodies do.
        turned = Turned(level, level, level, none)
        energies = kinetic, kinetic, zero, zero
        bounces = None if touching is None else Bounces.begin(touching)
        moved = turned, none > 0, turned, bounces
        return cls(motion, *moved, *energies, nothing, nothing, zero, zero)

    def follow(
        self,
        h: Float[Array, ""],
        motion: Motion,
        touching: Touching | None,
        kinetic: Float[Array, ""],
        gained: Float[Array, "2 bodies"],
        response: Response,
    ) -> "Phase":
        """Return the phase with a step of the length h added, by what is there at its end, and by
        what energy the turns and the rounds of each body have `gained` in it, and not by work [J].
        """
        bounces = self.bounces
        action = 0.5 * h * (self.kinetic + kinetic)
        if bounces is not None and touching is not None:
            action = touching.action(h, bounces.last, (self.kinetic, kinetic))
        time, integral = self.time + h, self.integral + action
        mean = integral / jnp.where(time > 0, time, 1)
        # No less than its mean, since swings that come to rest are no turns. At rest nothing is
        # known.
        usual = jnp.maximum(kinetic, mean)
        share = jnp.where(usual > 0, 0.5 / jnp.where(usual > 0, usual, 1), 0)
        # Forces at the end of the step, as of an implicit method, so that stiff ones are stable.
        pulled = self.gained + gained - response.early * self.early
        energy = pulled / (1 + share * (response.faster + h * response.early))
        early = self.early + h * share * energy
        largest = jnp.maximum(self.largest, kinetic)
        ratio = mean / jnp.where(largest > 0, largest, 1)
        bent = _BENT * jnp.abs(1 - 2 * ratio)
        before, sizes = self.motion, length(motion.spins)
        turns = self.turns.add(_turn(before.angles, motion.angles))
        rounds = self.rounds.add(_between(before.velocities, motion.velocities))
        counts = jnp.minimum(jnp.minimum(turns.reach / _WHOLE, 1) ** 2, bent)
        is_moved = self.is_moved | (length(motion.spins - before.spins) > _STEADY * sizes)
        off = jnp.where(turns.often & is_moved, sizes, 0) * jnp.abs(early[0])
        around = jnp.where(rounds.often & rounds.whirls, rounds.path, 0) * jnp.abs(early[1])
        around *= jnp.minimum(bent, 1) / jnp.where(time > 0, time, 1)
        if bounces is not None and touching is not None:
            bounces = bounces.follow(touching, length(motion.velocities), ratio * early[1])
            # One that hops along a floor turns its direction one way as it flies, and not back.
            around = jnp.where(bounces.often, 0, around)
        angle = jnp.maximum(self.angle, jnp.max(jnp.where(turns.whirls, off, 0)))
        swing = jnp.where(turns.whirls, 0, counts * off)
        swing = jnp.maximum(self.swing, jnp.max(jnp.maximum(swing, around)))
        energies = kinetic, largest, integral, time, energy, early
        return Phase(motion, turns, is_moved, rounds, bounces, *energies, angle, swing)

    @property
    def bounced(self) -> Float[Array, ""]:
        """By what share of its reach a body is off that has bounced."""
        if self.bounces is None:
            return jnp.zeros_like(self.time)
        return self.bounces.off(jnp.where(self.turns.whirls, 0, self.turns.reach))


def _turn(
    before: Float[Array, "bodies k"], after: Float[Array, "bodies k"]
) -> Float[Array, "bodies axes"]:
    """How far bodies turn from some angles to others, or from quaternions to others, by less than
    half a turn [rad].
    """
    if before.shape[1] == 1:
        return after - before
    sine = quaternions.apply(quaternions.space_matrix(before), after)
    cosine, size = jnp.sum(before * after, axis=1), length(sine)
    turn = 2 * jnp.arctan2(size, jnp.abs(cosine)) * jnp.sign(cosine)
    return sine * (turn / jnp.where(size > 0, size, 1))[:, None]


def _between(
    before: Float[Array, "bodies d"], after: Float[Array, "bodies d"]
) -> Float[Array, "bodies axes"]:
    """By what angles directions turn from some velocities to others [rad]; none where one of them
    is zero, or where a body turns back, which may be either way.
    """
    cosine = jnp.sum(before * after, axis=1, keepdims=True)
    if before.shape[1] == 2:
        # JAX has no cross product of the plane any more.
        sine = jnp.sum(perpendicular(before.T).T * after, axis=1, keepdims=True)
    else:
        sine = jnp.cross(before, after)
    size = jnp.sqrt(jnp.sum(sine**2, axis=1, keepdims=True))
    angle = jnp.arctan2(size, cosine)
    return sine * jnp.where(angle < _BACK, angle / jnp.where(size > 0, size, 1), 0)


def shares_of(
    energy: Energy,
    v: Float[Array, " n"],
    errors: tuple[Float[Array, " n"], Float[Array, " n"]],
    speeds: Float[Array, "bodies k"],
    speed_errors: tuple[Float[Array, "bodies k"], Float[Array, "bodies k"]],
) -> Float[Array, " bodies"]:
    """What share of a step's error of energy is one of each body's speed, as its method estimates
    it: all, where the motion has one freedom; of a motor's wheel little, where it is the carriage
    that vibrates.

    An error e of the motion changes the energy by ε = e_vᵀ ∂T/∂v + e_qᵀ ∂V/∂q, and if it is along
    the motion, the speed of each body by the share ε / 2T of it.

    **Arguments:**

    - `energy`, `v`: at the end of the step, of the system. `errors`: e_q, e_v of the step.
    - `speeds`: the angular velocities of bodies, or their velocities, and `speed_errors` by e_q
      and e_v.
    """
    # No derivative is taken of findings.
    parts = jax.lax.stop_gradient((energy, v, errors, speeds, speed_errors))
    energy, v, (of_q, of_v), speeds, (moved, faster) = parts
    change = multiply(energy.slope, of_q) + multiply(energy.momentum, of_v)
    own = length(faster) * 2 * energy.kinetic
    own += length(moved) * jnp.abs(multiply(energy.slope, v))
    own *= _SCATTER
    whole = length(speeds) * jnp.abs(change)
    return jnp.where(own < whole, own / jnp.where(whole > 0, whole, 1), 1.0)
