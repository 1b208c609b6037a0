"""How often bodies bounce, and how far off they are in a motion that is early."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...linalg.dense import length

# How often one contact has begun and ended when bodies bounce: before, errors have not added up.
_OFTEN = 3.0
# Errors are up to so many times the estimate: as much as it where a body flies up and falls, more
# where it strikes a stop just below its highest place, since slow parts of a flight vary most.
_SAFE = 3.0
# The least way of a body that is judged by itself, as a share of the largest of all.
_LEAST = 1e-6
# Bodies that turn to and fro by more than this angle [rad] swing.
_SWINGS = 1e-2


class Touching(NamedTuple):
    """The gaps of contacts, stops and ropes at a time, (contacts,), the positions of the frames of
    bodies [m], and how fast they gain kinetic energy from forces that have a potential energy,
    `gain` [W].
    """

    gaps: Float[Array, " contacts"]
    positions: Float[Array, "bodies d"]
    gain: Float[Array, ""]

    def action(
        self, h: Float[Array, ""], before: "Touching", kinetic: tuple[Array, Array]
    ) -> Float[Array, ""]:
        """The integral of the kinetic energy over a step of the length h, `before` and after which
        it is `kinetic` [J s]: that of Hermite's cubic, since one step may be a whole flight.
        """
        mean, most = 0.5 * (kinetic[0] + kinetic[1]), jnp.maximum(*kinetic)
        # Forces that a step does not resolve make nonsense of it.
        return h * jnp.clip(mean + h * (before.gain - self.gain) / 12, 0, 2 * most)


class Bounces(NamedTuple):
    """How bodies have bounced so far.

    A body that bounces flies to and fro, or up and down, for times t that go with the root of its
    energy E, t ~ E^(∓1/2). With the energy E + δE it is early by τ̇ = ± δE / 2E, which is the share
    T̄ / E of δE / 2T̄ (`Phase`), and E is the largest kinetic energy. Where bodies swing, the times
    between contacts are those of pendulums, and not judged so.

    - `last`: at the end of the last step. `changes` (contacts,): how often each began or ended.
    - `start` (bodies, d): positions there [m]; `reach` (bodies,): the largest distances from them
      [m]; `fastest` (bodies,): the largest speeds [m/s]; `error` (bodies,): the largest errors [m].
    """

    last: Touching
    changes: Float[Array, " contacts"]
    start: Float[Array, "bodies d"]
    reach: Float[Array, " bodies"]
    fastest: Float[Array, " bodies"]
    error: Float[Array, " bodies"]

    @classmethod
    def begin(cls, now: Touching) -> "Bounces":
        zero = jnp.zeros_like(now.positions[:, 0])
        return cls(now, 0 * now.gaps, now.positions, zero, zero, zero)

    def follow(
        self, now: Touching, speeds: Float[Array, " bodies"], early: Float[Array, " bodies"]
    ) -> "Bounces":
        """Return the bounces with a step added, by what is there at its end, the `speeds` of bodies
        [m/s], and by how `early` each is [s].
        """
        changes = self.changes + ((self.last.gaps < 0) != (now.gaps < 0))
        reach = jnp.maximum(self.reach, length(now.positions - self.start))
        fastest = jnp.maximum(self.fastest, speeds)
        error = jnp.maximum(self.error, fastest * jnp.abs(early))
        return Bounces(now, changes, self.start, reach, fastest, error)

    @property
    def often(self) -> Bool[Array, ""]:
        """Whether anything has bounced so often that errors of its energy have added up."""
        return jnp.any(self.changes > 2 * _OFTEN)

    def off(self, turned: Float[Array, " bodies"]) -> Float[Array, ""]:
        """By what share of its reach a body is off at most; `turned`: how far each has turned, to
        and fro [rad].
        """
        # What moves by rounding alone has no way to be a share of.
        reach = jnp.maximum(self.reach, _LEAST * jnp.max(self.reach))
        share = _SAFE * self.error / jnp.where(reach > 0, reach, 1)
        judged = self.often & jnp.all(turned < _SWINGS)
        return jnp.where(judged, jnp.max(share), 0)
