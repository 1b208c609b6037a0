"""Contacts that a step passes through: outside at both ends, and inside between them."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..system.base import AbstractSystem
from .search import first_crossing

# A step that starts on a surface is repeated with this share of its length.
_SHORTER = 0.25
# Nearer to its start than this share of a step, a passage begins with it.
_AT_START = 1e-3


class Passage(eqx.Module):
    """Which steps pass through a contact, whose force neither they nor their errors have seen.

    Such a step is repeated so that it ends where the contact begins, and the next one, which starts
    there, so that it ends inside.

    - `noise`: how deep inside is outside [m].
    """

    system: AbstractSystem
    post_step: Any
    noise: Float[Array, ""]

    def passed(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        between: diffrax.AbstractLocalInterpolation,
    ) -> tuple[Bool[Array, ""], Float[Array, ""]]:
        """Whether a step passes through a contact, and where it has to end instead [s]."""

        def gaps(share: Array) -> Array:
            t = t0 + share * (t1 - t0)
            q, v, *charts = between.evaluate(t)
            system = self.post_step.in_chart(self.system, *charts) if charts else self.system
            state = system.state(t, q, v)
            each = self.system.full.state(t, state.q, state.v).gaps()
            assert each is not None
            return each

        zero, one = jnp.zeros_like(t0), jnp.ones_like(t0)
        outside = (gaps(zero) >= -self.noise) & (gaps(one) > 0)

        def nearest(share: Array) -> Array:
            # Others have no rate, and turn nowhere.
            return jnp.min(jnp.where(outside, gaps(share), jnp.inf), keepdims=True)

        yes = jnp.ones(1, bool)
        crossing = first_crossing(
            nearest, jnp.ones_like(t0)[None], nearest(one), self.noise[None], yes, ~yes
        )
        begins = crossing.share <= _AT_START
        share = jnp.where(begins, _SHORTER, crossing.share)
        return crossing.exists, t0 + share * (t1 - t0)
