"""How often bodies bounce, and how far off they are in a motion that is early."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

# Contacts, each of which begins and ends, after which bodies bounce: before, errors have not added
# up.
_OFTEN = 3.0
# Errors are up to so many times the estimate: less than it where a body flies up and falls, more
# where it strikes a stop just below its highest place, since slow parts of a flight vary most.
_SAFE = 3.0


class Touching(NamedTuple):
    """The gaps of contacts, stops and ropes at a time, (contacts,), positions and velocities of the
    frames of bodies [m], [m/s].
    """

    gaps: Float[Array, " contacts"]
    positions: Float[Array, "bodies d"]
    velocities: Float[Array, "bodies d"]


class Bounces(NamedTuple):
    """How bodies have bounced so far.

    A body that bounces flies to and fro, or up and down, for times t that go with the root of its
    energy E, t ~ E^(∓1/2). With the energy E + δE it is early by τ̇ = ± δE / 2E, which is the share
    T̄ / E of δE / 2T̄ (`Phase`), and E is the largest kinetic energy.

    - `last`: at the end of the last step. `changes`: how often anything has begun or ended.
    - `start` (bodies, d): positions there [m]; `reach` (bodies,): the largest distances from them
      [m]; `fastest` (bodies,): the largest speeds [m/s]; `error` (bodies,): the largest errors [m].
    """

    last: Touching
    changes: Float[Array, ""]
    start: Float[Array, "bodies d"]
    reach: Float[Array, " bodies"]
    fastest: Float[Array, " bodies"]
    error: Float[Array, " bodies"]

    @classmethod
    def begin(cls, now: Touching) -> "Bounces":
        zero = jnp.zeros_like(now.positions[:, 0])
        return cls(now, jnp.zeros((), zero.dtype), now.positions, zero, zero, zero)

    def follow(self, now: Touching, early: Float[Array, " bodies"]) -> "Bounces":
        """Return the bounces with a step added, by what is there at its end, and by how `early`
        each body is [s].
        """
        changes = self.changes + jnp.sum((self.last.gaps < 0) != (now.gaps < 0))
        reach = jnp.maximum(self.reach, jnp.linalg.norm(now.positions - self.start, axis=1))
        fastest = jnp.maximum(self.fastest, jnp.linalg.norm(now.velocities, axis=1))
        error = jnp.maximum(self.error, fastest * jnp.abs(early))
        return Bounces(now, changes, self.start, reach, fastest, error)

    @property
    def often(self) -> Bool[Array, ""]:
        """Whether anything bounces so often that errors of its energy are errors of its times."""
        return self.changes > 2 * _OFTEN

    @property
    def off(self) -> Float[Array, ""]:
        """By what share of its reach a body is off at most."""
        share = _SAFE * self.error / jnp.where(self.reach > 0, self.reach, 1)
        return jnp.where(self.often, jnp.max(share), 0)
