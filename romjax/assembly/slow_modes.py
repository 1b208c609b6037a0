"""Flags of runs of scenes with capped modes."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..scene.body.capped import CappedBody
from ..system.base import AbstractSystem, AbstractValidity, Run
from ..system.flags import Flag
from .body_group import BodyGroup
from .counting import without_states

# Kinetic energy of the added mass that is too much, as a share of all: 1 % of the motion.
_SHARE = 1e-4


class SlowModes(AbstractValidity):
    """Capped modes are right where they follow their loads, and not where they vibrate.

    The mass that the cap adds hardly moves in the first case. In the second one it has as much
    kinetic energy as there is elastic energy in the capped modes.
    """

    def flags(self, system: AbstractSystem, run: Run) -> Int[Array, ""]:
        full: Any = system.full
        added, every = jax.vmap(lambda q, v: _energies(full.bodies, q, v))(run.q, run.v)
        return (jnp.max(added) > _SHARE * jnp.max(every)) * int(Flag.CAPPED)

    def including(self, run: Run) -> "SlowModes":
        del run
        return self


def _energies(
    groups: tuple[BodyGroup, ...], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The kinetic energy of what the cap has added, and of all bodies [J]."""
    added, every = jnp.zeros((), q.dtype), jnp.zeros((), q.dtype)
    for group in without_states(groups):
        every += jnp.sum(group.kinetic_energy(q, v))
        if isinstance(group.bodies, CappedBody):
            rates = group.coordinates.take(v)[:, group.bodies.frame_size :]
            mass = jax.vmap(lambda body: body.excess)(group.bodies) ** 2 - 1
            added += 0.5 * jnp.sum(mass * rates**2)
    return added, every
