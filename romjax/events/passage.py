"""Contacts that begin or end within a step: surfaces that a point passes, inwards or outwards."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..system.base import AbstractSystem
from .search import first_crossing

# On which side of a surface a step starts is told after this share of it: where it starts on one,
# where the step before has ended, its start does not know.
_START = 1e-3
# Nearer to its end than this share of a step, it ends at the surface; and steps are not cut to less
# than so many units in the last place of the time.
_END, _SHORTEST = 1e-6, 100
# How deep inside is outside, in units in the last place of the largest coordinate.
_ROUNDING = 100


class Passage(eqx.Module):
    """Which steps pass the surface of a contact, where its force has a kink.

    What a step across a kink estimates of its error may be zero by chance, and a step through a
    contact that is outside at both ends has seen no force at all. Such a step is repeated so that
    it ends at the surface that it passes first. The next one starts there, and what it does not
    know of the force is then a fixed share of what it estimates.
    """

    system: AbstractSystem
    post_step: Any

    def passed(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        between: diffrax.AbstractLocalInterpolation,
    ) -> tuple[Bool[Array, ""], Float[Array, ""]]:
        """Whether a step passes a surface, and where it has to end instead [s]."""
        span = t1 - t0

        def gaps(share: Array) -> Array:
            t = t0 + share * span
            q, v, *charts = between.evaluate(t)
            system = self.post_step.in_chart(self.system, *charts) if charts else self.system
            state = system.state(t, q, v)
            each = self.system.full.state(t, state.q, state.v).gaps()
            assert each is not None
            return each

        one, yes = jnp.ones_like(t0), jnp.ones(1, bool)
        side = jnp.sign(gaps(_START * one))

        def nearest(share: Array) -> Array:
            """How far the first one to pass its surface is from it, on the side of its start."""
            return jnp.min(jnp.where(side != 0, side * gaps(share), jnp.inf), keepdims=True)

        size = jnp.maximum(1.0, jnp.max(jnp.abs(self.system.full.q0)))
        noise = _ROUNDING * jnp.finfo(t0.dtype).eps * size
        crossing = first_crossing(nearest, one[None], nearest(one), noise[None], yes, ~yes)
        shortest = _SHORTEST * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
        is_within = (crossing.share > _START) & (crossing.share < 1 - _END)
        is_within &= (crossing.share * span > shortest) & ((1 - crossing.share) * span > shortest)
        return crossing.exists & is_within, t0 + crossing.share * span
